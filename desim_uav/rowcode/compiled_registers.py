"""What compiled code tells a processor: copies in registers, choices, memory needed soon."""

from __future__ import annotations

from typing import Any

from desim_uav.rowcode.compiled_types import I64, WORD, intrinsic, moved, number_at
from desim_uav.rowcode.numba_parts import cgutils, ir, types

# ---- copies of rows


def _copy(context: Any, builder: Any, row: Any, target: Any, source: Any) -> None:
    """Copy a row word by word, without marks: it may alias any field (see ``apart``)."""
    for k in range(row.cls.words):
        begin, end = (moved(builder, base, 8 * k) for base in (source, target))
        word = builder.load(number_at(context, builder, begin, I64))
        builder.store(word, number_at(context, builder, end, I64))


def _local_copy(typing_context: Any, row: Any) -> Any:
    """Return a local copy of a row, which the compiler keeps in registers."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        space = cgutils.alloca_once(builder, ir.ArrayType(WORD, row.cls.words))
        register = builder.bitcast(space, cgutils.voidptr_t)
        _copy(context, builder, row, register, arguments[0])
        return register

    return row(row), generate


def _put_back(typing_context: Any, row: Any, copy: Any) -> Any:
    """Write a copy of a row (see ``_local_copy``) back into the row."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        _copy(context, builder, row, *arguments)
        return context.get_dummy_value()

    return types.none(row, copy), generate


held, put_back = intrinsic(_local_copy), intrinsic(_put_back)


# ---- choices that a processor cannot predict


def _either(typing_context: Any, condition: Any, one: Any, other: Any) -> Any:
    """Return ``one`` if a condition holds, else ``other``, two whole numbers, without a jump."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        value = builder.select(*arguments)
        value.set_metadata("unpredictable", builder.module.add_metadata([]))
        return value

    return I64(types.boolean, I64, I64), generate


either: Any = intrinsic(_either)


def _precedes(typing_context: Any, t_us: Any, key: Any, t_other: Any, other_key: Any) -> Any:
    """Return whether a time and a key are before others: by time, then by key, without a jump.

    The two are compared as one number of 128 bits, which takes two instructions. Keys are not
    below 0.
    """

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        wide = ir.IntType(128)
        one, other = (
            builder.or_(
                builder.shl(builder.sext(high, wide), ir.Constant(wide, 64)),
                builder.zext(low, wide),
            )
            for high, low in (arguments[:2], arguments[2:])
        )
        return builder.icmp_signed("<", one, other)

    return types.boolean(I64, I64, I64, I64), generate


precedes: Any = intrinsic(_precedes)


def _bits_of(typing_context: Any, number: Any) -> Any:
    """Return how many bits a whole number above 0 has, without a jump."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        zeros = builder.ctlz(arguments[0], ir.Constant(ir.IntType(1), 1))
        return builder.sub(ir.Constant(WORD, 64), zeros)

    return I64(I64), generate


bits_of: Any = intrinsic(_bits_of)


# ---- memory that is needed soon


def _prefetch(typing_context: Any, address: Any) -> Any:
    """Let the processor fetch the cache line at an address, without waiting for it."""

    def generate(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
        i32, pointer = ir.IntType(32), cgutils.voidptr_t
        signature = ir.FunctionType(ir.VoidType(), [pointer, i32, i32, i32])
        fetch = cgutils.get_or_insert_function(builder.module, signature, "llvm.prefetch.p0")
        line = builder.inttoptr(arguments[0], pointer)
        builder.call(fetch, [line, i32(0), i32(2), i32(1)])  # data, to be read, second-level cache
        return context.get_dummy_value()

    return types.none(I64), generate


prefetch: Any = intrinsic(_prefetch)
