"""What is used of Numba that is not its public interface.

``tests/rowcode/test_kernels.py`` names the versions of Numba for which this holds.
"""

from __future__ import annotations

import gc
import sys
from typing import Any

import llvmlite.binding
import llvmlite.ir
import numba
import numpy as np
from numba.core import caching, errors, lowering, serialize
from numba.core import cgutils as _cgutils
from numba.core import codegen as _codegen
from numba.core import compiler as _compiler
from numba.core import targetconfig as _targetconfig
from numba.core import typed_passes as _typed_passes
from numba.core import types as _types
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic
from numba.core.imputils import Registry
from numba.core.typing import templates as _templates
from numba.np import arrayobj as _arrayobj

from desim_uav.rowcode.bounds import NOTE, NOTE_AT, CodePlace, OutsideError, own_class

types: Any = _types
cgutils: Any = _cgutils
ir: Any = llvmlite.ir
signature: Any = _templates.signature
populate_array: Any = _arrayobj.populate_array
_Code: Any = _codegen.JITCodeLibrary
_Compiler: Any = _compiler.Compiler
_ArrayExpressions: Any = _typed_passes.NopythonRewrites
_Options: Any = _targetconfig.TargetConfig
dumps: Any = serialize.dumps
add_symbol: Any = llvmlite.binding.add_symbol
TypingError: Any = errors.TypingError
FunctionCache: Any = caching.FunctionCache
AbstractTemplate: Any = _templates.AbstractTemplate
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


def is_registry(value: Any) -> bool:
    """Return whether a value is one of Numba's registries, in which functions are entered."""
    return isinstance(value, Registry)


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
    kinds = [kind for value, kind in _templates.builtin_registry.globals if value is function]
    templates = [one for kind in kinds for one in getattr(kind, "templates", ())]
    return [(one._overload_func, one._jit_options) for one in templates]


class _Unflagged(dict[Any, Any]):
    """What Numba has compiled of an overload, by types of arguments, whoever calls it.

    Numba's key ends with the options of the caller, so it would compile the same code again for a
    caller with other options. These matter only for what has no options of its own.
    """

    def __getitem__(self, key: Any) -> Any:
        return super().__getitem__(key[:3])

    def __setitem__(self, key: Any, value: Any) -> None:
        super().__setitem__(key[:3], value)


def share_last() -> None:
    """Let all callers share what is compiled of the last overload, which has options of its own."""
    _, kind = _templates.builtin_registry.globals[-1]
    for template in kind.templates:
        template._impl_cache = _Unflagged()


def address_of(compiled: Any, arguments: tuple[Any, ...]) -> int:
    """Return the address of the machine code for arguments of these types.

    It is called as compiled code calls a function, and returns whether it has ended by an error.
    """
    compiled.compile(arguments)
    code = compiled.overloads[arguments]
    return int(code.library.get_pointer_to_function(code.fndesc.llvm_func_name))


add_symbol(NOTE, NOTE_AT)


def fail_outside(
    context: Any, builder: Any, owner: str, of: str, place: CodePlace, numbers: tuple[Any, Any]
) -> None:
    """End a function by OutsideError, whose arguments these are."""
    kind = ir.FunctionType(ir.VoidType(), [one.type for one in numbers])
    builder.call(cgutils.get_or_insert_function(builder.module, kind, NOTE), numbers)
    context.call_conv.return_user_exc(builder, OutsideError, (owner, of, place))


def _check_array(context: Any, builder: Any, k: Any, size: Any, axis: int = 0) -> None:
    """In the place of Numba's check, whose error has no place: end a function by OutsideError.

    Numba has added the size to a negative index, and calls this where ``boundscheck`` is set.
    """
    with cgutils.if_unlikely(builder, builder.icmp_unsigned(">=", k, size)):
        negative = builder.icmp_signed("<", k, k.type(0))
        index = builder.select(negative, builder.sub(k, size), k)
        place, owner = _function_lowered()
        fail_outside(context, builder, owner, f"axis {axis}", place, (index, size))


cgutils.do_boundscheck = _check_array


def place_lowered() -> CodePlace:
    """Return the place in the source that is being made machine code by a caller of this."""
    return _function_lowered()[0]


def _function_lowered() -> tuple[CodePlace, str]:
    """Return that place, and the component of one's own that its function is a method of."""
    frame: Any = sys._getframe(1)
    while not isinstance(one := frame.f_locals.get("self"), lowering.BaseLower):
        frame = frame.f_back
    lower: Any = one
    function = lower.func_ir.func_id.func
    code = function.__code__
    return (code.co_filename, lower.loc.line, code.co_qualname), own_class(
        function.__module__, code.co_qualname
    )


class InnerCode(_Code):  # type: ignore[misc]
    """The code of a function that only kernels call: optimised and made machine code with theirs.

    Numba would do both for each such function by itself too, and again for each of its callers. It
    would also link the code of all that the function calls, once more for each of its callers.
    """

    _closed: Any = None

    def finalize(self) -> None:
        """Leave the code as it is: that of a kernel links all that this function calls."""
        self._raise_if_finalized()
        self._finalize_dynamic_globals()
        self._finalized = True

    def alone(self) -> Any:
        """Return the code of this function without that of the functions it calls."""
        return super()._get_module_for_linking()

    def _get_module_for_linking(self) -> Any:
        """Return the code with that of the functions it calls, for a function of Numba itself."""
        if self._closed is None:
            self._closed = self.alone().clone()
            link_reached(self, self._closed)
        return self._closed

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


class KernelCode(_Code):  # type: ignore[misc]
    """The code of a kernel, which links that of all functions in it once."""

    def finalize(self) -> None:
        """Link, optimise and make machine code."""
        link_reached(self, self._final_module)
        self._linking_libraries: list[Any] = []
        super().finalize()


def link_reached(library: Any, into: Any) -> None:
    """Link the code of all that a function calls, directly or not, into a module, each once."""
    reached = dict.fromkeys(library._linking_libraries)
    waiting = list(reached)
    for one in waiting:  # which grows
        inner = isinstance(one, InnerCode)
        into.link_in(one.alone() if inner else one._get_module_for_linking(), preserve=True)
        new = [other for other in one._linking_libraries if inner and other not in reached]
        reached.update(dict.fromkeys(new))
        waiting += new


class InnerCompiler(_Compiler):  # type: ignore[misc]
    """Numba's compiler, which makes InnerCode."""

    code: Any = InnerCode

    def define_pipelines(self) -> Any:
        """Return Numba's passes, for what makes no arrays without one that looks for such code."""
        name = self.state.func_id.func_qualname
        self.state.library = self.code(self.state.targetctx.codegen(), name)
        self.state.library.enable_object_caching()
        (passes,) = super().define_pipelines()
        if not self.state.flags.nrt:
            passes.passes = [one for one in passes.passes if one[0] is not _ArrayExpressions]
        return [passes]


class KernelCompiler(InnerCompiler):
    """Numba's compiler, which makes KernelCode."""

    code = KernelCode

    def compile_extra(self, function: Any) -> Any:
        """Compile without pauses to collect garbage, and without the time of each call of LLVM.

        Both take a tenth of the time. Numba keeps a time for each function, which nobody reads.
        """
        collects, lock = gc.isenabled(), llvmlite.binding.ffi.lib._lock
        timed, lock._cblist = lock._cblist, []
        gc.disable()
        try:
            return super().compile_extra(function)
        finally:
            lock._cblist = timed
            if collects:
                gc.enable()


def _same_options(one: Any, other: Any) -> Any:
    """Return whether two sets of options of functions are equal, without a look at each option.

    Numba looks at all options of the caller whenever it looks up what ``+`` means, for instance.
    """
    if not isinstance(other, _Options):
        return NotImplemented
    return one is other or one._values == other._values or one.values() == other.values()


_Options.__eq__, _Options.__hash__ = _same_options, lambda options: len(options.options)
