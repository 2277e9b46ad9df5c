"""Facts about the line that says what a long call does."""

import contextlib
import io
import threading
import time

import pytest

import packmech as pm
from packmech.calls.status import Status, shown_as, shows, words_of


class Terminal(io.StringIO):
    """A stream that somebody reads."""

    def isatty(self):
        return True


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("PACKMECH_PROGRESS", raising=False)


@contextlib.contextmanager
def terminal():
    """Give the stream that stands for standard error; pytest puts its own there between set-up and test."""
    with contextlib.redirect_stderr(Terminal()) as stream:
        yield stream


def wait_for(condition, seconds=10.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.02)
    assert condition()


def test_a_call_that_lasts_is_named_in_a_terminal_with_what_it_reports():
    with terminal() as stream:
        with shows("counting", after=0.05) as report:
            wait_for(lambda: "counting" in stream.getvalue())
            report("counting", {"steps": 12, "residual": 1e-3})
            wait_for(lambda: "residual 0.001" in stream.getvalue())
        assert Status.current is None


def test_a_short_call_shows_nothing():
    with terminal() as stream:
        with shows("counting", after=30.0):
            pass
        assert stream.getvalue() == ""


@pytest.mark.parametrize("progress", [False, print])
def test_no_line_is_shown_where_it_is_turned_off_or_a_function_listens(progress):
    with terminal() as stream:
        with shows("outer", progress, after=0.0):
            with shows("inner", after=0.0):
                pass
        assert stream.getvalue() == ""


def test_no_line_is_shown_where_the_environment_says_so(monkeypatch):
    with terminal() as stream:
        monkeypatch.setenv("PACKMECH_PROGRESS", "0")
        with shows("counting", after=0.0):
            pass
        assert stream.getvalue() == ""


def test_nobody_reads_a_stream_that_is_no_terminal():
    with contextlib.redirect_stderr(io.StringIO()) as stream, shows("counting", after=0.0):
        pass
    assert stream.getvalue() == ""


def test_calls_within_a_call_share_its_line():
    with terminal():
        with shows("outer", after=0.0):
            outer = Status.current
            with shows("inner", after=0.0) as report:
                assert Status.current is outer
                report("inner", {"step": 3})
            assert outer.words == "inner, step 3"
            assert Status.current is outer


def test_the_line_goes_away_with_an_error():
    with terminal():

        @shown_as("failing")
        def fail():
            raise ValueError("no")

        before = threading.active_count()
        with pytest.raises(ValueError, match="no"):
            fail()
        assert Status.current is None
        wait_for(lambda: threading.active_count() <= before)


def test_a_run_has_the_same_bits_with_its_progress_shown_passed_on_and_off():
    with terminal():
        scene = pm.Scene(pm.random_packing(24, dimension=2, packing_fraction=0.9, seed=1), (pm.Repulsion(),))
        heard = []
        asked = (None, True, False, lambda stage, figures: heard.append(stage))
        runs = [pm.jam(scene, 1e-4, progress=progress) for progress in asked]
        assert len({one.packing.position_nd.tobytes() for one in runs}) == 1
        assert heard


def test_what_is_no_progress_is_refused():
    scene = pm.Scene(pm.lattice_packing("square"), (pm.Repulsion(),))
    with pytest.raises(TypeError, match="progress must be a function"):
        pm.quench(scene, force_tolerance=1e-6, progress="yes")


def test_figures_that_are_no_numbers_are_left_out_of_the_words():
    assert words_of("jam", {"packing": object(), "done": True, "strain_rate": 0.25}) == "jam, done 1, strain rate 0.25"
