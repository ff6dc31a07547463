"""The kernels written for LLVM. Only this module and `llvm_vectors` build on interfaces which Numba may change.

`kernels` describes the functions and `plain_kernels` defines their bits. Three things make them fast:

- Products. BLAS is made for large matrices: for two of 128 x 128 it makes 96 billion operations a second on a machine
  where this kernel makes 236. The kernel keeps 8 x 32 results in registers and copies no operand.
- Compilation. Reference counts (`_nrt`) and the code by which Python calls a function take time to compile, so
  functions here have neither. Views of memory are written for LLVM. Each is used a dozen times, and a function in
  Python would take 10 to 20 milliseconds for each use.
- Calls. Numba looks at the type of every argument of every call; `fixed_types` does so once.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import llvmlite.binding
import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.ccallback import CFunc
from numba.core.errors import TypingError
from numba.core.imputils import impl_ret_borrowed
from numba.core.registry import CPUDispatcher
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from stlbench.contract import cached
from stlbench_agents.llvm_vectors import BYTE_POINTER, INT64, Vectors
from stlbench_agents.plain_kernels import PARTIAL_BYTES, VECTOR_BYTES, Floats, Matrix, inlined

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False}
jitted = partial(numba.njit, **_OPTIONS)


def compiled(function: Any) -> Any:
    return cached(jitted(function))


class _Part(CPUDispatcher):
    def __call__(self, *arguments: Any) -> None:
        raise TypeError(f"{self.py_func.__name__} is called by compiled functions alone")


def part(function: Any) -> Any:
    options = {"nopython": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **_OPTIONS}
    return cached(_Part(function, targetoptions=options))


def fixed_types(function: Any) -> Callable[..., None]:
    machine_code: Callable[..., None] | None = None

    def call(*arguments: Any) -> None:
        nonlocal machine_code
        if machine_code is None:
            signature = tuple(numba.typeof(argument) for argument in arguments)
            function.compile(signature)
            machine_code = function.get_overload(signature)
        machine_code(*arguments)

    return call


@intrinsic
def matrix(_: Any, values: Any, at: Any, rows: Any, columns: Any) -> Any:
    kind = types.NamedTuple([values, *[types.int64] * 5], Matrix)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        array, *places = args
        parts = [array, *places, places[-1], context.get_constant(types.int64, 1)]
        return impl_ret_borrowed(context, builder, kind, context.make_tuple(builder, kind, parts))

    return kind(values, types.int64, types.int64, types.int64), generate


@intrinsic
def transposed(_: Any, of: Any) -> Any:
    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        values, at, rows, columns, row, step = cgutils.unpack_tuple(builder, args[0])
        parts = [values, at, columns, rows, step, row]
        return impl_ret_borrowed(context, builder, of, context.make_tuple(builder, of, parts))

    return of(of), generate


@intrinsic
def flattened(_: Any, values: Any) -> Any:
    if values.layout != "C":
        raise TypingError("an array that does not lie row by row cannot be flattened without a copy")
    kind = types.Array(values.dtype, 1, "C")

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        array = context.make_array(values)(context, builder, args[0])
        flat = context.make_array(kind)(context, builder)
        populate_array(flat, array.data, [array.nitems], [array.itemsize], array.itemsize, array.meminfo, array.parent)
        return impl_ret_borrowed(context, builder, kind, flat._getvalue())

    return kind(values), generate


def _block(tall: int, vectors: int, narrow: bool = False) -> Any:
    """A function for `tall` rows and `vectors` of columns of a product; with `narrow` a part of one vector."""

    @intrinsic
    def block(_: Any, a: Any, b: Any, bias: Any, least: Any, out: Any, i: Any, j: Any) -> Any:
        signature = types.void(a, b, bias, least, out, types.intp, types.intp)

        def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
            builder.function.attributes.add("noinline")  # copies in `_blocks` would only take time to compile
            kinds = [kind.types[0] for kind in (a, b, bias, out)]
            parts = [cgutils.unpack_tuple(builder, args[place]) for place in (0, 1, 2, 4)]
            code = Vectors(context, builder, kinds[0].dtype, VECTOR_BYTES, parts[3][3] if narrow else None)
            (a_values, a_at, _, inner, a_row, a_step), (b_values, b_at, *_, b_row, _) = parts[:2]
            (bias_values, bias_at, bias_rows, *_), (out_values, out_at, *_, out_row, _) = parts[2:]
            i, j = args[5:]
            tops = code.rows(a_values, kinds[0], builder.add(a_at, builder.mul(i, a_row)), a_row, tall)
            bias_begin = code.address(bias_values, kinds[2], builder.add(bias_at, j))
            start = _started(code, bias_begin, bias_rows, vectors)
            left = code.address(b_values, kinds[1], builder.add(b_at, j))
            moves = code.in_bytes(a_step), code.in_bytes(b_row)
            sums = _summed(code, tops, left, moves, inner, [start] * tall)
            floor = code.spread(builder.fptrunc(args[3], code.number) if code.bytes == 4 else args[3])
            at = builder.add(builder.add(out_at, j), builder.mul(i, out_row))
            for address, row in zip(code.rows(out_values, kinds[3], at, out_row, tall), sums, strict=True):
                for v, total in enumerate(row):
                    above = builder.select(builder.fcmp_ordered(">", total, floor), total, floor)
                    code.store(above, code.shifted(address, INT64(v * VECTOR_BYTES)))
            return context.get_dummy_value()

        return signature, generate

    return block


def _started(code: Vectors, bias: ir.Value, rows: ir.Value, vectors: int) -> list[ir.Value]:
    """The first values of the sums of a row: the bias, or 0 if it has no rows."""
    builder = code.builder
    zeros = builder.bitcast(cgutils.alloca_once_value(builder, code.zero), BYTE_POINTER)
    is_empty = builder.icmp_signed("==", rows, INT64(0))
    places = (code.shifted(bias, INT64(v * VECTOR_BYTES)) for v in range(vectors))
    return [code.load(builder.select(is_empty, zeros, place), code.vector) for place in places]


def _summed(
    code: Vectors,
    tops: list[ir.Value],
    left: ir.Value,
    moves: tuple[ir.Value, ir.Value],
    inner: ir.Value,
    start: list[list[ir.Value]],
) -> list[list[ir.Value]]:
    """The loop over `inner` terms: to every sum adds an entry of its row of a, times a vector of a row of b."""
    builder = code.builder
    before, loop, after = builder.block, builder.append_basic_block("terms"), builder.append_basic_block("summed")
    builder.branch(loop)
    builder.position_at_end(loop)

    def variable(kind: ir.Type, first: ir.Value) -> Any:
        phi = builder.phi(kind)
        phi.add_incoming(first, before)
        return phi

    term, below = variable(INT64, INT64(0)), variable(BYTE_POINTER, left)
    heads = [variable(BYTE_POINTER, top) for top in tops]
    sums = [[variable(code.vector, first) for first in row] for row in start]
    vectors = [code.load(code.shifted(below, INT64(v * VECTOR_BYTES)), code.vector) for v in range(len(start[0]))]
    added = []
    for head, row in zip(heads, sums, strict=True):
        factor = code.spread(code.load(head, code.number))
        added.append([code.fused(factor, vector, total) for vector, total in zip(vectors, row, strict=True)])
    next_term = builder.add(term, INT64(1))
    term.add_incoming(next_term, loop)
    below.add_incoming(code.shifted(below, moves[1]), loop)
    for head in heads:
        head.add_incoming(code.shifted(head, moves[0]), loop)
    for row, new in zip(sums, added, strict=True):
        for total, value in zip(row, new, strict=True):
            total.add_incoming(value, loop)
    builder.cbranch(builder.icmp_signed("<", next_term, inner), loop, after)
    builder.position_at_end(after)
    return added


_TALL = 4 if VECTOR_BYTES == 32 else 8  # rows of a block. With two vectors a row, a block is what the registers hold
_LOW = _TALL // 2


def _tiled(tall: int, vectors: int, narrow: bool = False) -> Any:
    """A function that computes a product block by block; the last ones overlap, and write the same numbers again."""
    block = _block(tall, vectors, narrow)

    @inlined
    def tiles(a: Matrix, b: Matrix, bias: Matrix, least: float, out: Matrix) -> None:
        width = vectors * VECTOR_BYTES // a.values.itemsize
        for j in range(0, b.columns, width):
            left = max(0, min(j, b.columns - width))
            for i in range(0, out.rows, tall):
                block(a, b, bias, least, out, min(i, out.rows - tall), left)

    return tiles


_wide, _wide_low, _wide_row = _tiled(_TALL, 2), _tiled(_LOW, 2), _tiled(1, 2)
_medium, _medium_row = _tiled(_TALL, 1), _tiled(1, 1)
_narrow, _narrow_row = _tiled(_TALL, 1, narrow=True), _tiled(1, 1, narrow=True)


def _blocks(a: Matrix, b: Matrix, bias: Matrix, least: float, out: Matrix) -> None:
    width = VECTOR_BYTES // a.values.itemsize
    if b.columns < width:
        if out.rows < _TALL:
            _narrow_row(a, b, bias, least, out)
        else:
            _narrow(a, b, bias, least, out)
    elif b.columns < 2 * width:
        if out.rows < _TALL:
            _medium_row(a, b, bias, least, out)
        else:
            _medium(a, b, bias, least, out)
    elif out.rows < _LOW:
        _wide_row(a, b, bias, least, out)
    elif out.rows < _TALL:
        _wide_low(a, b, bias, least, out)
    else:
        _wide(a, b, bias, least, out)


_SINGLE = types.NamedTuple([types.Array(types.float32, 1, "C"), *[types.int64] * 5], Matrix)
_NAME = "stlbench_product_of_float32"
_ARGUMENTS = (_SINGLE, _SINGLE, _SINGLE, types.float64, _SINGLE)
_single = cached(CFunc(_blocks, (_ARGUMENTS, types.void), locals={}, options=_OPTIONS))
_single.compile()
llvmlite.binding.add_symbol(_NAME, _single.address)


@intrinsic
def product(_: Any, a: Any, b: Any, bias: Any, least: Any, out: Any) -> Any:
    """In single precision, call `_single` by its name: then it is compiled once, and not with each caller."""
    signature = types.void(a, b, bias, types.float64, out)

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        if {a, b, bias, out} != {_SINGLE}:
            return context.compile_internal(builder, _blocks, signature, args)
        function = ir.FunctionType(ir.VoidType(), [arg.type for arg in args])
        builder.call(cgutils.get_or_insert_function(builder.module, function, _NAME), args)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def _partial_sums(_: Any, a: Any, a_at: Any, b: Any, b_at: Any, count: Any) -> Any:
    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        code = Vectors(context, builder, a.dtype, PARTIAL_BYTES)
        total = cgutils.alloca_once_value(builder, code.zero)
        left, right = code.address(args[0], a, args[1]), code.address(args[2], b, args[3])
        with cgutils.for_range_slice(builder, INT64(0), args[4], INT64(code.lanes), intp=INT64) as (entry, _):
            offset = code.in_bytes(entry)
            first, second = (code.load(code.shifted(address, offset), code.vector) for address in (left, right))
            builder.store(code.fused(first, second, builder.load(total)), total)
        return code.sum(builder.load(total))

    return a.dtype(a, types.intp, b, types.intp, types.intp), generate


@intrinsic
def _row_sums(_: Any, a: Any, a_at: Any, row: Any, b: Any, b_at: Any, count: Any, into: Any, begin: Any) -> Any:
    """The inner products of several rows of a, `row` apart, each with the same `count` of b, in `into` from `begin` on.

    There are as many rows as partial sums. Halves are added as in `_partial_sums`, which gives the same bits.
    """

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        code = Vectors(context, builder, a.dtype, PARTIAL_BYTES)
        starts = code.rows(args[0], a, args[1], args[2], code.lanes)
        other = code.address(args[3], b, args[4])
        totals = [cgutils.alloca_once_value(builder, code.zero) for _ in starts]
        with cgutils.for_range_slice(builder, INT64(0), args[5], INT64(code.lanes), intp=INT64) as (entry, _):
            offset = code.in_bytes(entry)
            factor = code.load(code.shifted(other, offset), code.vector)
            for start, total in zip(starts, totals, strict=True):
                values = code.load(code.shifted(start, offset), code.vector)
                builder.store(code.fused(values, factor, builder.load(total)), total)
        rows = [builder.load(total) for total in totals]
        while len(rows) > 1:
            half = len(rows) // 2
            pairs = (code.exchanged(rows[i], rows[i + half], half) for i in range(half))
            rows = [builder.fadd(first, second) for first, second in pairs]
        code.store(rows[0], code.address(args[6], into, args[7]))
        return context.get_dummy_value()

    integers = types.intp, types.intp
    return types.void(a, *integers, b, *integers, into, types.intp), generate


@part
def inner_product(a: Floats, a_at: int, b: Floats, b_at: int, count: int) -> Any:
    lanes = PARTIAL_BYTES // a.itemsize
    whole = count // lanes * lanes
    total: Any = _partial_sums(a, a_at, b, b_at, whole)  # type: ignore[call-arg]  # Numba passes the context
    for i in range(whole, count):
        total += a[a_at + i] * b[b_at + i]
    return total


@part
def inner_products(a: Floats, a_at: int, rows: int, row: int, b: Floats, b_at: int, count: int, into: Floats) -> None:
    lanes, i = PARTIAL_BYTES // a.itemsize, 0
    if count % lanes == 0:
        while i + lanes <= rows:
            _row_sums(a, a_at + i * row, row, b, b_at, count, into, i)  # type: ignore[call-arg]  # as above
            i += lanes
    for rest in range(i, rows):
        into[rest] = inner_product(a, a_at + rest * row, b, b_at, count)


@intrinsic
def _transposed_block(_: Any, a: Any, at: Any, row: Any, into: Any, begin: Any, width: Any) -> Any:
    """Transpose the square block at `at`, its rows `row` apart, into `into` from `begin` on, its rows `width` apart."""

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, args: Any) -> Any:
        code = Vectors(context, builder, a.dtype, VECTOR_BYTES)
        rows = [code.load(address, code.vector) for address in code.rows(args[0], a, args[1], args[2], code.lanes)]
        distance = code.lanes
        while distance > 1:  # exchange the off-diagonal quarters of ever smaller squares
            distance //= 2
            for i in range(code.lanes):
                if not i & distance:
                    rows[i], rows[i + distance] = code.exchanged(rows[i], rows[i + distance], distance)
        for line, address in zip(rows, code.rows(args[3], into, args[4], args[5], code.lanes), strict=True):
            code.store(line, address)
        return context.get_dummy_value()

    return types.void(a, types.intp, types.intp, into, types.intp, types.intp), generate


@part
def copy_transposed(a: Floats, at: int, rows: int, columns: int, into: Floats) -> None:
    width = VECTOR_BYTES // a.itemsize
    if rows >= width and columns >= width:
        for i in range(0, rows, width):
            top = min(i, rows - width)  # the last block overlaps the one before, and writes the same again
            for j in range(0, columns, width):
                left = min(j, columns - width)
                begin = at + top * columns + left
                _transposed_block(a, begin, columns, into, left * rows + top, rows)  # type: ignore[call-arg]
        return
    for i in range(rows):
        for j in range(columns):
            into[j * rows + i] = a[at + i * columns + j]
