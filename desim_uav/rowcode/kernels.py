"""The decorators under which the model's numbers are compiled, and where machine code is kept.

A kernel is scalar code over flat arrays, compiled with strict IEEE arithmetic (no reassociation, no
contraction) and kept on disk. All that is not part of Numba's public interface is imported from
``rowcode.numba_parts``.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import pickle
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cached_property
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar, cast
from uuid import uuid4

import numba
from numba.extending import register_jitable

from desim_uav.errors import notice
from desim_uav.rowcode.bounds import CHECKED, is_own
from desim_uav.rowcode.code_digest import APART, RULES, STANDS_IN, code_digest
from desim_uav.rowcode.compiled_apart import called_by_cell
from desim_uav.rowcode.numba_parts import (
    VERSIONS,
    FunctionCache,
    KernelCompiler,
    cache_of,
    dumps,
    keep_in,
    let_kernels_call,
    settings,
    share_last,
)
from desim_uav.rowcode.options import CHECK, INNER, MAKER, OPTIONS, WITHIN, overload
from desim_uav.rowcode.regular_file import content_of, new_file
from desim_uav.rowcode.value_text import UndescribedError, ValueText

F = TypeVar("F", bound=Callable[..., Any])

NOWHERE = (
    "compiled code cannot be kept on disk and is compiled anew in each process, because neither "
    "{folder} nor your cache folder can be written; set NUMBA_CACHE_DIR to a folder that can be"
)

NOT_KEPT = (
    "compiled code of {name!r} is not kept on disk, and is compiled anew in each process, because "
    "it depends on a value whose changes cannot be detected: {value}"
)

ENDING = ".checked.nbc" if CHECKED else ".nbc"
"""The end of the names of files with machine code."""

CHECKSUM = hashlib.sha256().digest_size
MOST_BYTES = 2**30


def kernel(function: F) -> F:
    """Compile a function as a kernel that Python can call, and that makes no arrays."""
    return cached(function, OPTIONS)


def checked_kernel(function: F) -> F:
    """Compile a function of a component of one's own as a kernel."""
    return cached(function, {**OPTIONS, **CHECK})


def maker(function: F) -> F:
    """Compile a function as a kernel that Python can call, and that makes arrays or lists."""
    return cached(function, MAKER)


def part(function: F) -> F:
    """Compile a function as a kernel that becomes part of the machine code of its callers."""
    return cached(function, {**OPTIONS, "forceinline": True})


def cached(function: F, options: Mapping[str, Any]) -> F:
    """Compile with these options, and keep the machine code on disk if there is a place for it."""
    compiled: Any = numba.njit(**options, pipeline_class=KernelCompiler)(function)
    if hasattr(compiled, "enable_caching"):  # else NUMBA_DISABLE_JIT is set
        let_kernels_call(numba.njit(**{**options, **WITHIN})(function), compiled)
        try:
            keep_in(MachineCode(compiled), compiled)
        except RuntimeError:
            if multiprocessing.parent_process() is None:  # the parent prints it for all
                folder = Path(function.__code__.co_filename).parent
                _say_once("nowhere", NOWHERE.format(folder=folder))
    return cast(F, compiled)


def rule(function: F) -> F:
    """Have a function compiled with the kernels that call it; Python runs it as it stands."""
    RULES.add(cast(FunctionType, function))
    own = CHECK if is_own(function.__module__) else {}
    compilable: F = register_jitable(**{**INNER, **own})(function)
    share_last()
    return compilable


def rare_rule(function: F) -> F:
    """Have a rule compiled as a function of its own, which does not become part of its callers.

    It is for what seldom happens: code that is part of many callers takes long to compile.
    """
    RULES.add(cast(FunctionType, function))
    compilable: F = register_jitable(**{**INNER, "forceinline": False})(function)
    share_last()
    return compilable


def apart(function: F) -> F:
    """Have a rule compiled on its own when compiled code first calls it, which is by address.

    It is for what only some worlds need: it is not compiled for others. All its arguments are rows
    and numbers, and have annotations, as has the result.
    """
    plain: Any = function
    RULES.add(plain)
    APART.add(plain)
    called_by_cell(plain, lambda: kernel(function))
    return function


def stands_in_for(function: Any) -> Callable[[F], F]:
    """Return a decorator of the function that compiled code calls in place of another one."""

    def stand_in(implementation: F) -> F:
        STANDS_IN[function] = cast(FunctionType, implementation)
        registered: F = overload(function)(implementation)
        return registered

    return stand_in


def compiled_before(function: Any) -> bool:
    """Return whether machine code of the present source of a kernel is on disk."""
    try:
        return isinstance(cache_of(function), MachineCode) and bool(cache_of(function).file.read())
    except (OSError, ValueError):
        return False


def cache_folder(function: Any) -> Path | None:
    """Return the folder of a kernel's machine code, or None if no folder can be written.

    It is also None if NUMBA_DISABLE_JIT is set.
    """
    folder = cache_of(function).cache_path if hasattr(function, "enable_caching") else None
    return None if folder is None else Path(folder)


class NotOnDiskError(Exception):
    """Machine code is not on disk. ``keeps``: it will be there when it has been compiled once."""

    def __init__(self, keeps: bool) -> None:
        super().__init__("machine code is not on disk")
        self.keeps = keeps


_ONLY_FROM_DISK: ContextVar[bool] = ContextVar("only_from_disk", default=False)


@contextmanager
def only_from_disk() -> Iterator[None]:
    """Load kernels from disk in this block; raise NotOnDiskError where one is to be compiled."""
    before = _ONLY_FROM_DISK.set(True)
    try:
        yield
    finally:
        _ONLY_FROM_DISK.reset(before)


class MachineCode(FunctionCache):
    """The machine code of one kernel on disk.

    Raises Numba's RuntimeError if no folder can be written.
    """

    def __init__(self, compiled: Any) -> None:
        super().__init__(compiled.py_func)
        name = f"{self._impl.filename_base}{ENDING}"
        self.file = CodeFile(Path(self.cache_path) / name, compiled)
        base: Any = self
        base._cache_file = self.file  # whose load, save and flush it calls

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return the key of a signature and a processor.

        Numba's own key also has a digest of the pickled closure, which differs between processes
        if a class is in it. The closure is part of the file's origin.
        """
        return sig, codegen.magic_tuple()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code for a signature, or None; a damaged file is removed.

        Raises NotOnDiskError instead of returning None in a block ``only_from_disk``.
        """
        code = None
        try:
            code = super().load_overload(sig, target_context)
        except Exception as error:
            with suppress(OSError):  # another process may have removed it, with a notice
                self.file.path.unlink()
                problem = f"damaged compiled code is removed and made anew: {self.file.path}"
                _say_once("damaged", f"{problem} ({error})")
        if code is None and _ONLY_FROM_DISK.get():
            raise NotOnDiskError(self.file.origin is not None)
        return code

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code for a signature, if it can be written."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _say_once("unsaved", f"compiled code cannot be kept on disk: {error}")


class CodeFile:
    """The file of one kernel: a checksum, a digest of its origin, and the compiled signatures.

    It is written as a whole. Numba's own cache has an index beside its files and checks one source
    file only. It would therefore use outdated machine code after a change of a called kernel, or if
    a process ends, or another one writes, between the writing of the index and of a file.
    """

    def __init__(self, path: Path, compiled: Any) -> None:
        self.path = path
        self._compiled = compiled

    @cached_property
    def origin(self) -> bytes | None:
        """The digest of code, options and compiler, which is computed at the first call.

        It is None, with a notice, if the code depends on a value that cannot be described.
        """
        function, options = self._compiled.py_func, self._compiled.targetoptions
        try:
            digest = code_digest(function, placed="boundscheck" in options)
            parts = digest, ValueText().of(options), *VERSIONS, *settings()
        except UndescribedError as error:
            if multiprocessing.parent_process() is None:  # the parent prints it for all
                name = function.__qualname__.replace("<locals>.", "")
                _say_once(str(error), NOT_KEPT.format(name=name, value=error))
            return None
        return hashlib.sha256(repr(parts).encode()).digest()

    def read(self) -> dict[Any, bytes]:
        """Return the compiled signatures, or none if they have another origin, or an unknown one.

        Raises ValueError if the file is damaged.
        """
        if self.origin is None:
            return {}
        try:
            content = content_of(self.path, MOST_BYTES)
        except FileNotFoundError:
            return {}
        checksum, rest = content[:CHECKSUM], content[CHECKSUM:]
        if checksum != hashlib.sha256(rest).digest():
            raise ValueError("its checksum does not fit")
        fits = rest[:CHECKSUM] == self.origin
        return dict(pickle.loads(rest[CHECKSUM:])) if fits else {}

    def load(self, key: Any) -> Any:
        """Return the object that was saved under a key, or None."""
        vars(self).pop("origin", None)  # a value may have changed since the last signature
        pickled = self.read().get(key)
        return None if pickled is None else pickle.loads(pickled)

    def save(self, key: Any, data: Any) -> None:
        """Save an object under a key; the other keys stay as they are."""
        if self.origin is not None:
            self._write(self.origin, {**self.read(), key: dumps(data)})

    def flush(self) -> None:
        """Remove all signatures from the file."""
        if self.origin is not None:
            self._write(self.origin, {})

    def _write(self, origin: bytes, signatures: dict[Any, bytes]) -> None:
        rest = origin + dumps(signatures)
        draft = self.path.with_name(f"{self.path.name}.{uuid4().hex[:16]}")
        try:
            with new_file(draft) as file:
                file.write(hashlib.sha256(rest).digest() + rest)
            draft.replace(self.path)
        except BaseException:
            draft.unlink(missing_ok=True)
            raise


_said: set[str] = set()


def _say_once(kind: str, words: str) -> None:
    """Print one line on stderr, if it is the first of its kind in this process."""
    if kind not in _said:
        _said.add(kind)
        notice(words)
