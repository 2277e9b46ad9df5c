"""Settings of the whole suite: the same examples in every run, so that a red run can be repeated.

`pytest --hypothesis-profile=explore` draws new ones.
"""

import signal

from hypothesis import settings

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("explore", derandomize=False, deadline=None)
settings.load_profile("repeatable")

# a shell that starts the suite in the background makes it deaf to Ctrl-C, and the tests that press it with it
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
