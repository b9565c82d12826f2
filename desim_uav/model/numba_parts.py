"""What is used of Numba that is not its public interface.

``tests/model/test_kernels.py`` names the versions of Numba for which this holds.
"""

from __future__ import annotations

from typing import Any

import llvmlite.ir
from numba.core import caching, serialize
from numba.core import cgutils as _cgutils
from numba.core import codegen as _codegen
from numba.core import compiler as _compiler
from numba.core import types as _types
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


def keep_in(cache: Any, compiled: Any) -> None:
    """Let a compiled function keep its machine code in a cache."""
    compiled._cache = cache


def let_kernels_call(inner: Any, compiled: Any) -> None:
    """Let kernels call ``inner``, whose code becomes part of theirs, in place of a kernel."""
    compiled.get_call_template, compiled.get_overload = inner.get_call_template, inner.get_overload


def cache_of(compiled: Any) -> Any:
    """Return the cache of a compiled function."""
    return compiled._cache


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
