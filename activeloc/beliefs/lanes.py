"""Eight numbers at a time: what compiled kernels load, multiply, add and store at once.

A compiler does several numbers at once where it can tell that a loop is long and its arrays do not
overlap. The loops over the headings of a cell are short and there are many of them; so they are
written out here, eight headings to a *lane group*, and stay in registers from one to the next. Sums
and products of lanes are those of the numbers, in the order written: no rounding differs between
machines.

These are called in compiled code alone. Arrays are flat and contiguous, of float32 or float64, and
places in them are ``np.uint64``; nothing is checked.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.datamodel.models import PrimitiveModel
from numba.extending import intrinsic, register_model

N_LANES = 8
_INDEX, _WORD = ir.IntType(32), ir.IntType(64)
_LN2 = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # High and low part.
_LOG = (
    6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01,
    2.222219843214978396e-01, 1.818357216161805012e-01, 1.531383769920937332e-01,
    1.479819860511658591e-01,
)  # fmt: skip
"""Coefficients of s^2, s^4 ... in the logarithm of the mantissa; see :func:`log`."""
# To the type checkers Numba's are no classes, nor what it makes of a function the same function.
_in_line: Any = intrinsic
_Type: Any = types.Type
_Primitive: Any = PrimitiveModel


class Lanes(_Type):  # type: ignore[misc]
    """Numba's type of eight numbers.

    Args:
        of: Their type.
    """

    def __init__(self, of: Any) -> None:
        self.of = of
        super().__init__(name=f"Lanes({of})")


@register_model(Lanes)
class _Register(_Primitive):  # type: ignore[misc]
    """They are kept in a vector register."""

    def __init__(self, manager: Any, of: Any) -> None:
        number = manager.lookup(of.of).get_value_type()
        super().__init__(manager, of, ir.VectorType(number, N_LANES))


def _vector(context: Any, of: Any) -> Any:
    return ir.VectorType(context.get_value_type(of), N_LANES)


def _pointer(context: Any, builder: Any, kind: Any, array: Any, at: Any) -> Any:
    """Where eight elements of an array begin."""
    first = builder.gep(context.make_array(kind)(context, builder, value=array).data, [at])
    return builder.bitcast(first, _vector(context, kind.dtype).as_pointer())


@_in_line
def load(typing: Any, array: Any, at: Any) -> Any:
    """Eight elements of an array from ``at`` on."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, array, args[0], args[1])
        return builder.load(pointer, align=array.dtype.bitwidth // 8)

    return Lanes(array.dtype)(array, types.uint64), generate


@_in_line
def store(typing: Any, array: Any, at: Any, lanes: Any) -> Any:
    """Write eight elements of an array from ``at`` on."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, array, args[0], args[1])
        builder.store(args[2], pointer, align=array.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, types.uint64, lanes), generate


@_in_line
def fill(typing: Any, number: Any) -> Any:
    """One number eight times."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        vector = _vector(context, number)
        empty = ir.Constant(vector, ir.Undefined)
        one = builder.insert_element(empty, args[0], ir.Constant(_INDEX, 0))
        everywhere = ir.Constant(ir.VectorType(_INDEX, N_LANES), [0] * N_LANES)
        return builder.shuffle_vector(one, empty, everywhere)

    return Lanes(number)(number), generate


def _pairwise(name: str, what: str) -> Any:
    """An operation on two groups of eight."""

    def operation(typing: Any, a: Any, b: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return getattr(builder, name)(*args)

        return a(a, b), generate

    operation.__doc__ = what
    operation.__name__ = name
    return _in_line(operation)


add = _pairwise("fadd", "Sums.")
mul = _pairwise("fmul", "Products.")
sub = _pairwise("fsub", "Differences.")


@_in_line
def at_least(typing: Any, a: Any, b: Any, otherwise: Any) -> Any:
    """Those of a that are at least those of b; those of a third where not."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">=", args[0], args[1]), args[0], args[2])

    return a(a, b, otherwise), generate


@_in_line
def any_above(typing: Any, a: Any, b: Any) -> Any:
    """Whether any of a is larger than its b, or not a number."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bits = ir.IntType(N_LANES)
        holds = builder.bitcast(builder.fcmp_unordered(">", args[0], args[1]), bits)
        return builder.icmp_unsigned("!=", holds, ir.Constant(bits, 0))

    return types.boolean(a, b), generate


@_in_line
def widened(typing: Any, lanes: Any) -> Any:
    """As float64."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        if lanes.of == types.float64:
            return args[0]
        return builder.fpext(args[0], _vector(context, types.float64))

    return Lanes(types.float64)(lanes), generate


@_in_line
def log(typing: Any, lanes: Any) -> Any:
    """Natural logarithms of positive normal float64, to a unit in the last place.

    x = 2^e m with m in [sqrt(1/2), sqrt(2)), s = (m - 1) / (m + 1), and log m = 2 artanh s by the
    polynomial of FreeBSD's ``e_log.c`` (Sun Microsystems, 1993): log m = f - f^2 / 2 + s (f^2 / 2
    + R(s^2)) with f = m - 1.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        reals = _vector(context, types.float64)
        whole = ir.VectorType(ir.IntType(64), N_LANES)

        def all_of(kind: Any, number: Any) -> Any:
            return ir.Constant(kind, [number] * N_LANES)

        def polynomial(x: Any, *coefficients: float) -> Any:
            result = all_of(reals, coefficients[-1])
            for c in coefficients[-2::-1]:
                result = builder.fadd(all_of(reals, c), builder.fmul(x, result))
            return result

        bits = builder.bitcast(args[0], whole)
        above = builder.sub(bits, all_of(whole, 0x3FE6A09E00000000))  # sqrt(1/2)
        exponent = builder.ashr(above, all_of(whole, 52))
        m = builder.bitcast(builder.sub(bits, builder.shl(exponent, all_of(whole, 52))), reals)
        # Put in the last bits of 1.5 * 2^52, a small whole number is a float64 at once.
        shifted = builder.add(exponent, all_of(whole, 0x4338000000000000))
        e = builder.fsub(builder.bitcast(shifted, reals), all_of(reals, 6755399441055744.0))
        f = builder.fsub(m, all_of(reals, 1.0))
        s = builder.fdiv(f, builder.fadd(f, all_of(reals, 2.0)))
        z = builder.fmul(s, s)
        w = builder.fmul(z, z)
        odd = polynomial(w, *_LOG[0::2])
        even = polynomial(w, *_LOG[1::2])
        r = builder.fadd(builder.fmul(z, odd), builder.fmul(w, even))
        half = builder.fmul(all_of(reals, 0.5), builder.fmul(f, f))
        low = builder.fadd(
            builder.fmul(s, builder.fadd(half, r)), builder.fmul(e, all_of(reals, _LN2[1]))
        )
        rest = builder.fsub(builder.fsub(half, low), f)
        return builder.fsub(builder.fmul(e, all_of(reals, _LN2[0])), rest)

    return lanes(lanes), generate


@_in_line
def total(typing: Any, lanes: Any) -> Any:
    """Sum of the eight as float64: the first four to the last four, and so on by halves."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        wide = args[0]
        if lanes.of != types.float64:
            wide = builder.fpext(wide, _vector(context, types.float64))
        each = [builder.extract_element(wide, ir.Constant(_INDEX, i)) for i in range(N_LANES)]
        while len(each) > 1:
            half = len(each) // 2
            each = [builder.fadd(each[i], each[half + i]) for i in range(half)]
        return each[0]

    return types.float64(lanes), generate


@_in_line
def look_up(typing: Any, table: Any, first: Any, indices: Any, at: Any) -> Any:
    """Elements ``first + index`` of a table for eight unsigned indices, an array's from ``at``."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        of = context.make_array(table)(context, builder, value=args[0]).data
        where = context.make_array(indices)(context, builder, value=args[2]).data
        of, bits = builder.gep(of, [args[1]]), indices.dtype.bitwidth
        words = builder.bitcast(builder.gep(where, [args[3]]), _WORD.as_pointer())
        lanes = ir.Constant(_vector(context, table.dtype), ir.Undefined)
        per_word, mask = _WORD.width // bits, ir.Constant(_WORD, 2**bits - 1)
        for i in range(N_LANES):
            # Several indices loaded as one word and taken apart: less than to load each.
            n, j = divmod(i, per_word)
            if j == 0:
                at = builder.gep(words, [ir.Constant(_WORD, n)])
                word = builder.load(at, align=bits // 8)
            index = builder.and_(builder.lshr(word, ir.Constant(_WORD, bits * j)), mask)
            number = builder.load(builder.gep(of, [index]))
            lanes = builder.insert_element(lanes, number, ir.Constant(_INDEX, i))
        return lanes

    return Lanes(table.dtype)(table, types.uint64, indices, types.uint64), generate
