"""SIMD arithmetic on many small matrices at once, for numba: a value holds one number of each of 16 tasks.

The last axis of an array (..., WIDTH) runs over WIDTH tasks. `load` reads such a row as a `Lanes`, a SIMD
vector of LLVM, and arithmetic on it is done for all tasks at once. Written as loops over the last axis the
same products run a twentieth to a hundredth as fast: numba's arrays may overlap, so LLVM writes every partial
sum back to memory.

Arrays are C-contiguous; indices are not checked.
"""

import operator
from collections.abc import Callable
from functools import cache
from typing import Any

from llvmlite import ir
from numba import extending, njit, types
from numba.core import cgutils
from numba.extending import models, overload, register_model
from numba.np.arrayobj import make_array

WIDTH = 16  # tasks; in float32 one register of AVX-512, two of AVX2, four of NEON

_TILE_ROWS, _TILE_COLUMNS = 2, 4  # tile of a matrix product whose partial sums stay in registers
intrinsic: Any = extending.intrinsic  # its own type keeps the typing context among the arguments
_CONTRACT = ("contract",)  # fast-math flag: fused multiply-add is allowed, nothing else is relaxed


class Lanes(types.Type):
    """One number of each of WIDTH tasks."""

    def __init__(self, dtype: types.Type):
        self.dtype = dtype
        super().__init__(name=f"Lanes({dtype})")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, lanes: Lanes):
        number = manager.lookup(lanes.dtype).get_value_type()
        super().__init__(manager, lanes, ir.VectorType(number, WIDTH))


class _Matrix:
    """Reads and writes entries of an argument (rows, columns, WIDTH) during code generation."""

    def __init__(self, context: Any, builder: ir.IRBuilder, kind: types.Array, value: ir.Value):
        self.builder = builder
        self.vector = ir.VectorType(context.get_value_type(kind.dtype), WIDTH)
        array = make_array(kind)(context, builder, value)
        self.numbers = array.data
        self.rows, self.columns = cgutils.unpack_tuple(builder, array.shape)[:2]

    def read(self, row: ir.Value, column: ir.Value) -> ir.Value:
        return _read(self.builder, self._address(row, column))

    def write(self, row: ir.Value, column: ir.Value, value: ir.Value) -> None:
        _write(self.builder, value, self._address(row, column))

    def _address(self, row: ir.Value, column: ir.Value) -> ir.Value:
        vectors = self.builder.bitcast(self.numbers, self.vector.as_pointer())
        return self.builder.gep(vectors, [self.builder.add(self.builder.mul(row, self.columns), column)])


def _read(builder: ir.IRBuilder, address: ir.Value) -> ir.Value:
    value = builder.load(address)
    value.align = 4  # bytes; holds for any array
    return value


def _write(builder: ir.IRBuilder, value: ir.Value, address: ir.Value) -> None:
    builder.store(value, address).align = 4


@intrinsic
def load(typingctx, array, row, column):  # type: ignore[no-untyped-def]
    """Return entry (row, column) of an array (rows, columns, WIDTH)."""

    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return _Matrix(context, builder, signature.args[0], args[0]).read(*args[1:])

    return Lanes(array.dtype)(array, types.intp, types.intp), generate


@intrinsic
def store(typingctx, array, row, column, lanes):  # type: ignore[no-untyped-def]
    """Set entry (row, column) of an array (rows, columns, WIDTH)."""

    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        _Matrix(context, builder, signature.args[0], args[0]).write(*args[1:])
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, lanes), generate


@intrinsic
def square_root(typingctx, lanes):  # type: ignore[no-untyped-def]
    """Return the square root of each lane."""

    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        vector = args[0].type
        name = f"llvm.sqrt.v{WIDTH}f{signature.args[0].dtype.bitwidth}"
        function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(vector, [vector]), name)
        return builder.call(function, args)

    return lanes(lanes), generate


def _register(operation: Callable[..., Any], instruction: str) -> None:
    """Define an operator of Python for two Lanes."""

    @intrinsic
    def on_lanes(typingctx, a, b):  # type: ignore[no-untyped-def]
        def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
            return getattr(builder, instruction)(*args, flags=_CONTRACT)

        return a(a, b), generate

    @overload(operation)
    def typed(a, b):  # type: ignore[no-untyped-def]
        if isinstance(a, Lanes) and isinstance(b, Lanes):
            return lambda a, b: on_lanes(a, b)
        return None


for _operation, _instruction in {
    operator.add: "fadd",
    operator.sub: "fsub",
    operator.mul: "fmul",
    operator.truediv: "fdiv",
}.items():
    _register(_operation, _instruction)


@cache
def product(
    transpose_a: bool = False,
    transpose_b: bool = False,
    scale: float = 1.0,
    add: bool = False,
    lower: bool = False,
) -> Any:
    """Compiled function (C, A, B) that computes C = scale A B for the matrices of every task.

    Args:
        transpose_a: take A'.
        transpose_b: take B'.
        scale: a factor.
        add: add to the previous value of C.
        lower: compute the lower triangle only; tiles on the diagonal are computed as a whole.
    """
    general = _product(transpose_a, transpose_b)

    @njit(error_model="numpy")
    def multiply(C, A, B):  # type: ignore[no-untyped-def]
        general(C, A, B, scale, add, lower)

    return multiply


@cache
def _product(transpose_a: bool, transpose_b: bool) -> Any:
    whole = _tile(_TILE_ROWS, _TILE_COLUMNS, transpose_a, transpose_b)
    column = _tile(_TILE_ROWS, 1, transpose_a, transpose_b)
    entry = _tile(1, 1, transpose_a, transpose_b)

    @njit(error_model="numpy")
    def multiply(C, A, B, scale, add, lower):  # type: ignore[no-untyped-def]
        rows, columns = C.shape[:2]
        for i in range(0, rows - rows % _TILE_ROWS, _TILE_ROWS):
            end = min(i + _TILE_ROWS, columns) if lower else columns
            j = 0
            while j < end:
                if j + _TILE_COLUMNS <= columns:
                    whole(C, i, j, A, B, scale, add)
                    j += _TILE_COLUMNS
                else:
                    column(C, i, j, A, B, scale, add)
                    j += 1
        for i in range(rows - rows % _TILE_ROWS, rows):
            for j in range(min(i + 1, columns) if lower else columns):
                entry(C, i, j, A, B, scale, add)

    return multiply


def _tile(rows: int, columns: int, transpose_a: bool, transpose_b: bool) -> Callable[..., None]:
    """Function (C, i, j, A, B, scale, add) for one tile of a product: `rows` x `columns` from (i, j) on."""

    @intrinsic
    def tile(typingctx, C, i, j, A, B, scale, add):  # type: ignore[no-untyped-def]
        def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
            # One copy for all callers: if inlined, it would be compiled a dozen times.
            builder.function.attributes.add("noinline")
            C, A, B = (_Matrix(context, builder, signature.args[n], args[n]) for n in (0, 3, 4))
            places = [
                (builder.add(args[1], args[1].type(r)), builder.add(args[2], args[2].type(c)))
                for r in range(rows)
                for c in range(columns)
            ]
            sums = []
            for _ in places:
                sums.append(cgutils.alloca_once(builder, C.vector))
                builder.store(ir.Constant(C.vector, None), sums[-1])
            with cgutils.for_range(builder, A.rows if transpose_a else A.columns) as loop:
                n = loop.index
                left, right = {}, {}
                for row, column in places:
                    if row not in left:
                        left[row] = A.read(n, row) if transpose_a else A.read(row, n)
                    if column not in right:
                        right[column] = B.read(column, n) if transpose_b else B.read(n, column)
                for (row, column), total in zip(places, sums, strict=True):
                    term = builder.fmul(left[row], right[column], flags=_CONTRACT)
                    builder.store(builder.fadd(term, builder.load(total), flags=_CONTRACT), total)
            number = context.cast(builder, args[5], signature.args[5], signature.args[0].dtype)
            factor = ir.Constant(C.vector, ir.Undefined)
            for lane in range(WIDTH):
                factor = builder.insert_element(factor, number, ir.IntType(32)(lane))
            for (row, column), total in zip(places, sums, strict=True):
                held = builder.select(args[6], C.read(row, column), ir.Constant(C.vector, None))
                scaled = builder.fmul(factor, builder.load(total), flags=_CONTRACT)
                C.write(row, column, builder.fadd(scaled, held, flags=_CONTRACT))
            return context.get_dummy_value()

        return types.void(C, types.intp, types.intp, A, B, scale, types.boolean), generate

    return tile


@intrinsic
def transpose(typingctx, source, begin, step, target, target_begin, target_step):  # type: ignore[no-untyped-def]
    """Copy a block of WIDTH x WIDTH numbers from one array to another, transposed.

    Row i of the block begins at index begin + i step of the flattened array.
    """

    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        def addresses(kind, value, begin, step):  # type: ignore[no-untyped-def]
            numbers = make_array(kind)(context, builder, value).data
            vector = ir.VectorType(context.get_value_type(kind.dtype), WIDTH).as_pointer()
            for i in range(WIDTH):
                place = builder.add(begin, builder.mul(step, step.type(i)))
                yield builder.bitcast(builder.gep(numbers, [place]), vector)

        rows = [_read(builder, x) for x in addresses(signature.args[0], *args[:3])]
        # Blocks of 1, 2, 4, ... are swapped across the diagonal.
        half = 1
        while half < WIDTH:
            upper = [c if not c & half else WIDTH + c - half for c in range(WIDTH)]
            lower = [c + half if not c & half else WIDTH + c for c in range(WIDTH)]
            upper, lower = (ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), x) for x in (upper, lower))
            for i in range(WIDTH):
                if not i & half:
                    pair = rows[i], rows[i + half]
                    rows[i] = builder.shuffle_vector(*pair, upper)
                    rows[i + half] = builder.shuffle_vector(*pair, lower)
            half *= 2
        for row, address in zip(rows, addresses(signature.args[3], *args[3:]), strict=True):
            _write(builder, row, address)
        return context.get_dummy_value()

    places = (types.intp, types.intp)
    return types.void(source, *places, target, *places), generate
