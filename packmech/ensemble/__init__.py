"""Many runs of one job over seeds and parameters: a folder for each, on whatever engine of `concurrent.futures`.

The folder is the state. It is a signac project: ``workspace/<id>/signac_statepoint.json`` names a member's parameters,
and the id is signac's hash of them. ``result.json`` beside it holds its result, ``failure.json`` why
nothing did; either is written under another name and moved into place when it is whole. Nothing else is remembered
anywhere, so that any process may end at any time: what is there stays, what is missing is run by whoever comes next.

`members` names and numbers them, `folder` reads and writes, `jobs` says what a member runs, `worker` runs members in a
process of its own under limits, `run` hands them to an executor or runs them here, `table` and `statistics` read what
came of them.

`drawing` is the figure of an ensemble, and `shear_series` a call that is one itself: scenes are kept once beside its
members, failures pass on.
"""
