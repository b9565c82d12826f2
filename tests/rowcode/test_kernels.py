"""Machine code on disk: it is of the code that runs, whole, and not needed."""

from __future__ import annotations

import gc
import importlib.util
import inspect
import itertools
import multiprocessing
import os
import re
import sys
import time
from importlib.metadata import requires
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import pytest
from packaging.requirements import Requirement

from desim_uav.rowcode import kernels, numba_parts

HOLDS_FOR = ("0.61", "0.62", "0.63", "0.64", "0.65", "0.66", "0.67", "0.68")
"""Versions of Numba whose private parts are as ``rowcode.kernels`` uses them."""

SOURCE = """
from desim_uav.rowcode.kernels import kernel

@kernel
def of_ones_own(x):
    return {factor} * x
"""

COMPONENT = """
from dataclasses import dataclass

from desim_uav.rowcode.compiled_rows import pointer_to
from desim_uav.rowcode.components import own_kernel, ruled, values_of
from desim_uav.rowcode.packing import packed

@dataclass(frozen=True)
class Times:
    factor: {kind}

    def of(self, x):
        return self.factor * x{more}

def around(cls, values_at):
    method = ruled(cls.of)

    def scaled(address, x):
        return method(values_at(address), x)

    return scaled

values = values_of(Times({factor}))
block = packed(values)
scaled = own_kernel(around(Times, pointer_to(type(values))), Times)

def of_ones_own(x):
    return scaled(block.ctypes.data, x)

of_ones_own.stats = scaled.stats
"""
"""A kernel whose closure has a method, and the row of its numbers, of a class of components."""

numbers = itertools.count()


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder for sources, and a user's cache folder; nothing has been said yet."""
    monkeypatch.setattr(kernels, "_said", set())
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.setattr(sys, "pycache_prefix", None)
    for name in ("HOME", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(tmp_path / "home"))


def module_of(folder: Path, source: str, name: str = "mine", at_s: int | None = None) -> ModuleType:
    """A file of sources as a new process imports it; ``at_s``: when the file was written.

    The name of the module may be a path, of which the file has the last part.
    """
    folder.mkdir(exist_ok=True)
    file = folder / f"{Path(name).stem}.py"
    file.write_text(source)
    written = next(numbers) if at_s is None else at_s
    os.utime(file, (written, written))
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def told(module: ModuleType, x: float = 1.0) -> tuple[float, bool]:
    """What the kernel gives, and whether its machine code came from disk."""
    result = module.of_ones_own(x)
    return result, bool(module.of_ones_own.stats.cache_hits)


def files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.nbc"))


# ---- machine code is of the code that runs


def test_it_is_compiled_once(tmp_path):
    assert told(module_of(tmp_path, SOURCE.format(factor=2.5))) == (2.5, False)
    assert len(files(tmp_path / "__pycache__")) == 1
    assert told(module_of(tmp_path, SOURCE.format(factor=2.5))) == (2.5, True)


def test_a_kernel_around_a_component_is_compiled_once(tmp_path):
    """Its closure has a class that each process makes anew."""
    for factor, from_disk in [("2.5", False), ("2.5", True), ("4.5", True)]:
        source = COMPONENT.format(kind="float", factor=factor, more="")
        assert told(module_of(tmp_path, source), 3.0) == (float(factor) * 3.0, from_disk)


@pytest.mark.parametrize(
    ("kind", "factor", "more", "result"),
    [("int", "2", "", 6.0), ("float", "2.5", " + 1.0", 8.5)],
)
def test_a_changed_component_is_compiled_anew(tmp_path, kind, factor, more, result):
    """Its fields' types, or its method."""
    first = COMPONENT.format(kind="float", factor="2.5", more="")
    assert told(module_of(tmp_path, first), 3.0) == (7.5, False)
    changed = COMPONENT.format(kind=kind, factor=factor, more=more)
    assert told(module_of(tmp_path, changed), 3.0) == (result, False)


def test_components_in_files_that_are_named_by_paths_are_kept(tmp_path):
    """Long ones, with what no file name may contain; both modules are of files of one name."""
    paths = [f"/{one}/" + 'a: b\\*?"<>|/' * 30 + "mine.py" for one in ("one", "other")]
    for more, result, from_disk in [
        ("", 7.5, False),
        ("", 7.5, True),
        (" + 1.0", 8.5, False),
        (" + 1.0", 8.5, True),
    ]:
        source = COMPONENT.format(kind="float", factor="2.5", more=more)
        for path in paths:
            assert told(module_of(tmp_path, source, path), 3.0) == (result, from_disk)
    names = [file.name for file in files(tmp_path / "__pycache__")]
    assert len(names) == 2 and all(re.fullmatch(r"[a-zA-Z0-9_.-]{1,99}", name) for name in names)


def test_a_changed_constant_is_compiled_anew(tmp_path):
    """Nothing but a constant: its byte code, of which Numba keeps account, stays the same."""
    assert told(module_of(tmp_path, SOURCE.format(factor=2.5))) == (2.5, False)
    assert told(module_of(tmp_path, SOURCE.format(factor=3.5))) == (3.5, False)


@pytest.mark.parametrize("value", ["np.int64({})", "np.bool_({} - 2)", "(0, ({},))[1][0]"])
def test_a_changed_constant_of_any_type_is_compiled_anew(tmp_path, value):
    source = SOURCE.replace("import kernel\n", "import kernel\nimport numpy as np\nX = {value}\n")
    for number, from_disk in [(2, False), (2, True), (3, False)]:
        module = module_of(tmp_path, source.format(factor="X", value=value.format(number)))
        assert told(module, 4.0) == (module.X * 4.0, from_disk)


def test_a_changed_constant_some_dots_away_is_compiled_anew(tmp_path):
    source = SOURCE.replace("import kernel\n", "import kernel\nimport own_package.rates\n")
    for name in ("own_package", "own_package.rates"):
        sys.modules[name] = ModuleType(name)
    sys.modules["own_package"].rates = rates = sys.modules["own_package.rates"]
    for gap, from_disk in [(2.5, False), (2.5, True), (3.5, False)]:
        rates.GAP_S = gap
        module = module_of(tmp_path, source.format(factor="own_package.rates.GAP_S"))
        assert told(module) == (gap, from_disk)
    del sys.modules["own_package"], sys.modules["own_package.rates"]


def test_code_with_a_value_that_cannot_be_described_is_not_kept(tmp_path, capsys):
    """Two files have one notice, which names the value."""
    source = """
from decimal import Decimal
from numba.extending import overload
from desim_uav.rowcode.kernels import kernel
X = Decimal({factor})
def factor():
    return float(X)
@overload(factor)
def _factor():
    number = float(X)
    return lambda: number
@kernel
def of_ones_own(x):
    return factor() * x
"""
    for number in (2, 3, 3):
        module = module_of(tmp_path, source.format(factor=number))
        assert told(module) == (float(number), False)
        assert not kernels.compiled_before(module.of_ones_own)
    assert files(tmp_path) == []
    assert capsys.readouterr().err.splitlines() == [
        "desim-uav: compiled code of 'of_ones_own' is not kept on disk, and is compiled anew in "
        "each process, because it depends on a value whose changes cannot be detected: "
        "'X' in 'mine.factor' is a value of type 'decimal.Decimal'"
    ]


def test_settings_of_numba_count(tmp_path, monkeypatch):
    """``NUMBA_BOUNDSCHECK`` and ``NUMBA_OPT``, for instance."""
    assert told(module_of(tmp_path, SOURCE.format(factor=2.5))) == (2.5, False)
    monkeypatch.setattr(numba.config, "BOUNDSCHECK", 1)
    assert told(module_of(tmp_path, SOURCE.format(factor=2.5))) == (2.5, False)
    assert told(module_of(tmp_path, SOURCE.format(factor=2.5))) == (2.5, True)


def test_python_may_run_older_code_than_the_file_holds(tmp_path):
    """A file that is written twice in a second, at the same length, looks unchanged to Python.

    What was compiled of the old code must not be taken for the new code's, once Python sees it.
    """
    assert told(module_of(tmp_path, SOURCE.format(factor=2.5), at_s=10**9)) == (2.5, False)
    assert told(module_of(tmp_path, SOURCE.format(factor=3.5), at_s=10**9)) == (2.5, True)
    assert told(module_of(tmp_path, SOURCE.format(factor=3.5), at_s=10**9 + 1)) == (3.5, False)


OTHER = """
from desim_uav.rowcode.kernels import kernel
FACTOR = {factor}

@kernel
def doubled(x):
    return {two} * x
"""
CALLS = """
from desim_uav.rowcode.kernels import kernel
from other import FACTOR, doubled

@kernel
def of_ones_own(x):
    return FACTOR * doubled(x)
"""


@pytest.mark.parametrize("changed", [{"factor": 7.5}, {"two": 3.0}])
def test_a_change_in_another_file_is_compiled_anew(tmp_path, monkeypatch, changed):
    monkeypatch.setitem(sys.modules, "other", None)
    now = {"factor": 2.5, "two": 2.0}
    module_of(tmp_path, OTHER.format(**now), "other")
    assert told(module_of(tmp_path, CALLS)) == (5.0, False)
    now |= changed
    module_of(tmp_path, OTHER.format(**now), "other")
    assert told(module_of(tmp_path, CALLS)) == (now["factor"] * now["two"], False)


def test_a_writer_that_is_cut_off_leaves_the_old_file(tmp_path, monkeypatch, capsys):
    """Of the index and the file of Numba's own cache, the index alone would be the new one."""
    assert told(module_of(tmp_path, SOURCE.format(factor=2.5))) == (2.5, False)
    with monkeypatch.context() as disk:
        disk.setattr(Path, "replace", full)
        assert told(module_of(tmp_path, SOURCE.format(factor=3.5))) == (3.5, False)
    assert "compiled code cannot be kept on disk: " in capsys.readouterr().err
    assert len(list((tmp_path / "__pycache__").glob("*.nbc*"))) == 1
    assert told(module_of(tmp_path, SOURCE.format(factor=3.5))) == (3.5, False)
    assert told(module_of(tmp_path, SOURCE.format(factor=3.5))) == (3.5, True)


def full(*_: Any) -> None:
    raise OSError(28, "No space left on device")


def test_signatures_that_two_processes_compile_at_once_are_not_mixed_up(tmp_path, monkeypatch):
    """Both begin with no file; whoever writes last leaves a file that holds its own alone."""
    one, other = (module_of(tmp_path, SOURCE.format(factor=2)) for _ in range(2))
    with monkeypatch.context() as at_once:
        at_once.setattr(kernels.CodeFile, "read", lambda file: {})
        assert (one.of_ones_own(3), other.of_ones_own(1.5)) == (6, 3.0)
    assert told(module_of(tmp_path, SOURCE.format(factor=2)), 3) == (6, False)
    assert told(module_of(tmp_path, SOURCE.format(factor=2)), 1.5) == (3.0, True)
    assert told(module_of(tmp_path, SOURCE.format(factor=2)), 3) == (6, True)


def compile_and_call(folder: Path, number: int) -> float:
    """What the kernel gives in a process of its own, which waits for the other process."""
    (folder / f"ready{number}").touch()
    while len(list(folder.glob("ready*"))) < 2:
        time.sleep(0.01)
    spec = importlib.util.spec_from_file_location("mine", folder / "mine.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["mine"] = module
    spec.loader.exec_module(module)
    return float(module.of_ones_own(1.0))


@pytest.mark.thorough
def test_two_processes_compile_at_once(tmp_path, monkeypatch):
    folder, place = tmp_path / "sources", tmp_path / "kernels"
    folder.mkdir()
    (folder / "mine.py").write_text(SOURCE.format(factor=2.5))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(place))
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        given = pool.starmap(compile_and_call, [(folder, 0), (folder, 1)], chunksize=1)
    assert given == [2.5, 2.5]
    (file,) = files(place)
    assert list(file.parent.iterdir()) == [file]
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(place))
    assert told(module_of(folder, SOURCE.format(factor=2.5))) == (2.5, True)


# ---- damage


def flipped(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


DAMAGES = {
    "empty": lambda content: b"",
    "garbage": lambda content: b"garbage" * 100,
    "cut off": lambda content: content[:-100],
    "a flipped bit": flipped,
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_removed_and_made_anew(tmp_path, capsys, damage):
    told(module_of(tmp_path, SOURCE.format(factor=2.5)))
    (file,) = files(tmp_path)
    whole = file.read_bytes()
    file.write_bytes(DAMAGES[damage](whole))
    assert not kernels.compiled_before(module_of(tmp_path, SOURCE.format(factor=2.5)).of_ones_own)
    assert told(module_of(tmp_path, SOURCE.format(factor=2.5))) == (2.5, False)
    assert capsys.readouterr().err.splitlines() == [
        "desim-uav: damaged compiled code is removed and made anew: "
        f"{file} (its checksum does not fit)"
    ]
    assert files(tmp_path) == [file]
    assert told(module_of(tmp_path, SOURCE.format(factor=2.5))) == (2.5, True)


def test_many_damaged_files_are_told_in_one_line(tmp_path, capsys):
    for name in "abc":
        told(module_of(tmp_path, SOURCE.format(factor=2.5), name))
    for file in files(tmp_path):
        file.write_bytes(b"")
    for name in "abc":
        assert told(module_of(tmp_path, SOURCE.format(factor=2.5), name)) == (2.5, False)
    assert len(capsys.readouterr().err.splitlines()) == 1


# ---- where it is kept


def read_only(folder: Path) -> None:
    """Where nothing can be cached, for an administrator neither: a file is in the way."""
    folder.mkdir()
    (folder / "__pycache__").touch()


def test_a_read_only_installation_uses_the_users_cache_folder(tmp_path, capsys):
    installed = tmp_path / "installed"
    read_only(installed)
    first = module_of(installed, SOURCE.format(factor=2.5))
    assert told(first) == (2.5, False)
    (file,) = files(tmp_path)
    assert file.is_relative_to(tmp_path / "home")
    assert kernels.cache_folder(first.of_ones_own) == file.parent
    assert told(module_of(installed, SOURCE.format(factor=2.5))) == (2.5, True)
    assert capsys.readouterr().err == ""


def test_with_nowhere_to_cache_each_process_compiles_anew(tmp_path, capsys):
    installed = tmp_path / "installed"
    read_only(installed)
    (tmp_path / "home").touch()
    for name in "abc":
        module = module_of(installed, SOURCE.format(factor=2.5), name)
        assert told(module) == (2.5, False)
        assert kernels.cache_folder(module.of_ones_own) is None
        assert not kernels.compiled_before(module.of_ones_own)
    assert files(tmp_path) == []
    assert capsys.readouterr().err.splitlines() == [
        "desim-uav: compiled code cannot be kept on disk and is compiled anew in each process, "
        f"because neither {installed} nor your cache folder can be written; set NUMBA_CACHE_DIR "
        "to a folder that can be"
    ]


# ---- functions within kernels


@kernels.kernel
def _twice(x: float) -> float:
    return 2.0 * x


@kernels.rule
def _plus_one(x: float) -> float:
    return _twice(x) + 1.0


@kernels.kernel
def _outer(x: float) -> float:
    return _plus_one(x) * _twice(x)


def test_a_kernel_within_a_kernel_is_not_made_machine_code_of_its_own():
    if not hasattr(_twice, "overloads"):
        pytest.skip("nothing is compiled")
    assert _outer(3.0) == 42.0
    assert not _twice.overloads
    assert _twice(4.0) == 8.0
    assert len(_twice.overloads) == 1
    assert _outer(1.5) == 12.0


# ---- what of Numba is private


def _identity(x: int) -> int:
    return x


def test_the_private_parts_of_numba_are_as_they_were():
    """If this fails with a newer Numba: see whether ``numba_parts`` holds, then name it above."""
    version = ".".join(numba.__version__.split(".")[:2])
    (range_,) = (
        one for one in map(Requirement, requires("desim-uav") or ()) if one.name == "numba"
    )
    assert all(range_.specifier.contains(f"{known}.0") for known in HOLDS_FOR)
    if version not in HOLDS_FOR:
        pytest.skip(f"Numba {version} is newer than {HOLDS_FOR[-1]}")
    cache = kernels.kernel(lambda x: x)._cache
    assert isinstance(cache, kernels.MachineCode)
    for name in ("load_overload", "save_overload", "cache_path", "_impl", "_cache_file"):
        assert hasattr(cache, name), name
    for name in ("_load_overload", "_save_overload"):
        assert "self._index_key(" in inspect.getsource(getattr(kernels.FunctionCache, name))
    assert isinstance(cache._impl.filename_base, str)
    assert numba_parts.address_of(kernels.kernel(_identity), (numba.int64,)) > 0
    assert list(inspect.signature(numba_parts.InnerCode.finalize).parameters) == ["self"]
    for name in ("_optimize_final_module", "_finalize_final_module", "_get_module_for_linking"):
        assert hasattr(numba_parts._Code, name), name
    assert isinstance(numba_parts.llvmlite.binding.ffi.lib._lock._cblist, list)
    assert isinstance(numba_parts._Options()._values, dict)
    source = inspect.getsource(numba_parts._templates._OverloadFunctionTemplate._get_impl)
    assert "cache_key = self.context, tuple(args), tuple(kws.items())" in source


def test_numba_collects_no_garbage_while_a_kernel_is_compiled():
    lock, seen = numba_parts.llvmlite.binding.ffi.lib._lock, []
    timed = list(lock._cblist)

    class Watched(kernels.KernelCompiler):
        def define_pipelines(self):
            seen.append((gc.isenabled(), list(lock._cblist)))
            return super().define_pipelines()

    assert numba.njit(pipeline_class=Watched)(_identity)(3) == 3
    assert seen == [(False, [])]
    assert gc.isenabled() and lock._cblist == timed
    with pytest.raises(numba.TypingError):
        numba.njit(pipeline_class=Watched)(lambda x: x.missing)(3)
    assert gc.isenabled() and lock._cblist == timed
