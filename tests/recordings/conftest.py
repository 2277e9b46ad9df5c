"""Scripts of recordings as modules, by their path without its ending; skipped where recordings are not shipped."""

import importlib.util
import pathlib

import pytest

RECORDINGS = pathlib.Path(__file__).parents[2] / "recordings"


@pytest.fixture(scope="session")
def script():
    def load(name):
        path = RECORDINGS / f"{name}.py"
        if not path.exists():
            pytest.skip(f"no recordings/{name}.py here")
        spec = importlib.util.spec_from_file_location(f"recordings_{name.replace('/', '_')}", path)
        module = importlib.util.module_from_spec(spec)
        with pytest.MonkeyPatch.context() as patch:
            # as when it is run: its own folder comes first
            patch.syspath_prepend(path.parent)
            spec.loader.exec_module(module)
        return module

    return load
