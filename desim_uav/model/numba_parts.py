"""What is used of Numba that is not its public interface.

``tests/model/test_kernels.py`` names the versions of Numba for which this holds.
"""

from __future__ import annotations

from typing import Any

import llvmlite.ir
import numba
import numpy as np
from numba.core import caching, serialize
from numba.core import cgutils as _cgutils
from numba.core import codegen as _codegen
from numba.core import compiler as _compiler
from numba.core import types as _types
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic
from numba.core.typing import templates as _templates
from numba.np import arrayobj as _arrayobj

types: Any = _types
cgutils: Any = _cgutils
ir: Any = llvmlite.ir
signature: Any = _templates.signature
populate_array: Any = _arrayobj.populate_array
_Code: Any = _codegen.JITCodeLibrary
_Compiler: Any = _compiler.Compiler
dumps: Any = serialize.dumps
FunctionCache: Any = caching.FunctionCache
AttributeTemplate: Any = _templates.AttributeTemplate

WITHOUT_COUNTING: dict[str, Any] = {"_nrt": False}
"""An option of ``njit``: what makes no arrays need not count references to those it is given. Said
of each kernel: on disk it is the same whether Python has called it first, or another kernel."""


VERSIONS = (numba.__version__, llvmlite.__version__, np.__version__)
"""The versions of the packages by which functions are compiled."""

SETTINGS = (
    *("OPT", "BOUNDSCHECK", "DEBUGINFO_DEFAULT", "EXTEND_VARIABLE_LIFETIMES", "LOOP_VECTORIZE"),
    *("SLP_VECTORIZE", "USING_SVML", "LLVM_REFPRUNE_PASS", "LLVM_REFPRUNE_FLAGS", "DEBUG_NRT"),
)


def settings() -> list[str]:
    """Return the settings of Numba (``NUMBA_OPT`` and so on) that machine code depends on."""
    return [f"{name} {getattr(numba.config, name, None)!s}" for name in SETTINGS]


def keep_in(cache: Any, compiled: Any) -> None:
    """Let a compiled function keep its machine code in a cache."""
    compiled._cache = cache


def let_kernels_call(inner: Any, compiled: Any) -> None:
    """Let kernels call ``inner``, whose code becomes part of theirs, in place of a kernel."""
    compiled.get_call_template, compiled.get_overload = inner.get_call_template, inner.get_overload


def cache_of(compiled: Any) -> Any:
    """Return the cache of a compiled function."""
    return compiled._cache


def is_compiled(value: Any) -> bool:
    """Return whether a value is a function with a decorator of Numba, and not another object."""
    return isinstance(value, Dispatcher | _Intrinsic)


def name_of_type(value: Any) -> str:
    """Return the full name of a type of compiled code or LLVM, or "" if there is none."""
    if not isinstance(value, _types.Type | llvmlite.ir.Type | llvmlite.ir.Constant):
        return ""
    name = str(getattr(value, "name", value))
    return "" if "jitclass" in name or " at 0x" in name else name


def overloads_of(function: Any) -> list[tuple[Any, Any]]:
    """Return the functions that compile in the place of a function, each with its options."""
    known = [kind for value, kind in _templates.builtin_registry.globals if value is function]
    templates = [one for kind in known for one in getattr(kind, "templates", ())]
    return [(one._overload_func, one._jit_options) for one in templates]


def address_of(compiled: Any, arguments: tuple[Any, ...]) -> int:
    """Return the address of the machine code for arguments of these types; C code can call it."""
    compiled.compile(arguments)
    found = compiled.overloads[arguments]
    return int(found.library.get_pointer_to_function(found.fndesc.llvm_cfunc_wrapper_name))


class InnerCode(_Code):  # type: ignore[misc]
    """The code of a function that only kernels call: optimised and made machine code with theirs.

    Numba would do both for each such function by itself too, and again for each of its callers.
    """

    def _optimize_final_module(self) -> None: ...

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: there is no machine code."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """Return what has ``set_env``, which there is no machine code for either."""
        return InnerCode

    @staticmethod
    def set_env(name: str, env: Any) -> None:
        """Do nothing."""


class InnerCompiler(_Compiler):  # type: ignore[misc]
    """Numba's compiler, which makes InnerCode."""

    def define_pipelines(self) -> Any:
        """Return Numba's passes."""
        name = self.state.func_id.func_qualname
        self.state.library = InnerCode(self.state.targetctx.codegen(), name)
        return super().define_pipelines()
