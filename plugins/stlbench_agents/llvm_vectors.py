"""Vectors of numbers in functions that are written for LLVM. It builds on interfaces which Numba may change."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

INT64, INT32 = ir.IntType(64), ir.IntType(32)
BYTE_POINTER = ir.IntType(8).as_pointer()


class Vectors:
    """Loads, stores and arithmetic of vectors of numbers of one type, in a function that is being built."""

    def __init__(
        self, context: Any, builder: ir.IRBuilder, number: types.Float, size: int, columns: ir.Value | None = None
    ) -> None:
        """Args: `size` of a vector in bytes; `columns`, if given, how many of its numbers are loaded and stored."""
        self.builder, self.context = builder, context
        self.bytes = number.bitwidth // 8
        self.lanes = size // self.bytes
        self.number: ir.Type = context.get_value_type(number)
        self.vector = ir.VectorType(self.number, self.lanes)
        self.zero = ir.Constant(self.vector, [0.0] * self.lanes)
        function = ir.FunctionType(self.vector, [self.vector] * 3)
        name = f"llvm.fmuladd.v{self.lanes}f{number.bitwidth}"
        self._fused = cgutils.get_or_insert_function(builder.module, function, name)
        self._mask = None if columns is None else self._first(columns)

    def address(self, array: Any, kind: types.Array, entry: ir.Value) -> ir.Value:
        data = self.context.make_array(kind)(self.context, self.builder, array).data
        return self.shifted(self.builder.bitcast(data, BYTE_POINTER), self.in_bytes(entry))

    def rows(self, array: Any, kind: types.Array, at: ir.Value, row: ir.Value, count: int) -> list[ir.Value]:
        """The addresses of so many rows: of the entry `at`, and of those that follow `row` apart."""
        add, multiply = self.builder.add, self.builder.mul
        return [self.address(array, kind, add(at, multiply(INT64(i), row))) for i in range(count)]

    def in_bytes(self, entries: ir.Value) -> ir.Value:
        return self.builder.mul(entries, INT64(self.bytes))

    def shifted(self, address: ir.Value, distance: ir.Value) -> ir.Value:
        return self.builder.gep(address, [distance])

    def _first(self, columns: ir.Value) -> ir.Value:
        """A mask of a vector's first numbers."""
        kind = ir.VectorType(INT64, self.lanes)
        return self.builder.icmp_signed("<", ir.Constant(kind, list(range(self.lanes))), self._spread(columns, kind))

    def load(self, address: ir.Value, kind: ir.Type) -> ir.Value:
        if self._mask is not None and kind is self.vector:
            return self._masked("load", self.vector, [address, INT32(self.bytes), self._mask, self.zero])
        loaded = self.builder.load(self.builder.bitcast(address, kind.as_pointer()))
        loaded.align = self.bytes
        return loaded

    def store(self, vector: ir.Value, address: ir.Value) -> None:
        if self._mask is not None:
            self._masked("store", ir.VoidType(), [vector, address, INT32(self.bytes), self._mask])
            return
        self.builder.store(vector, self.builder.bitcast(address, self.vector.as_pointer())).align = self.bytes

    def _masked(self, operation: str, result: ir.Type, args: list[ir.Value]) -> ir.Value:
        function = ir.FunctionType(result, [arg.type for arg in args])
        name = f"llvm.masked.{operation}.v{self.lanes}f{8 * self.bytes}.p0"
        return self.builder.call(cgutils.get_or_insert_function(self.builder.module, function, name), args)

    def spread(self, number: ir.Value) -> ir.Value:
        return self._spread(number, self.vector)

    def _spread(self, value: ir.Value, kind: ir.VectorType) -> ir.Value:
        undefined = ir.Constant(kind, ir.Undefined)
        everywhere = ir.Constant(ir.VectorType(INT32, self.lanes), [0] * self.lanes)
        first = self.builder.insert_element(undefined, value, INT32(0))
        return self.builder.shuffle_vector(first, undefined, everywhere)

    def fused(self, a: ir.Value, b: ir.Value, c: ir.Value) -> ir.Value:
        """a b + c; rounded twice under a mask, as the reference does for narrow products."""
        if self._mask is not None:
            return self.builder.fadd(c, self.builder.fmul(a, b))
        return self.builder.call(self._fused, [a, b, c])

    def exchanged(self, upper: ir.Value, lower: ir.Value, distance: int) -> tuple[ir.Value, ir.Value]:
        """Two rows of a square, the upper's right parts exchanged with the lower's left parts."""
        lanes, kind = range(self.lanes), ir.VectorType(INT32, self.lanes)
        left = [self.lanes + lane - distance if lane & distance else lane for lane in lanes]
        right = [self.lanes + lane if lane & distance else lane + distance for lane in lanes]
        first, second = (self.builder.shuffle_vector(upper, lower, ir.Constant(kind, mask)) for mask in (left, right))
        return first, second

    def sum(self, vector: ir.Value) -> ir.Value:
        """The sum of a vector's numbers, half added to half."""
        count = self.lanes
        while count > 1:
            count //= 2
            mask = [lane + count if lane < count else 0 for lane in range(self.lanes)]
            upper = self.builder.shuffle_vector(vector, vector, ir.Constant(ir.VectorType(INT32, self.lanes), mask))
            vector = self.builder.fadd(vector, upper)
        return self.builder.extract_element(vector, INT32(0))
