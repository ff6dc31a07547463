"""JSON schemas of task files and study files, by which editors complete and check them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from stlbench.records.status import accidents_of
from stlbench.registry.docstrings import field_docs
from stlbench.study import study
from stlbench.task.entry import Entry, read_both
from stlbench.task.file import TaskFile

Kind = Literal["task", "study"]

_TEXT = {"type": "string"}
_NUMBER = {"type": "number"}
_NAMES = {"anyOf": [_TEXT, {"type": "array", "items": _TEXT}]}
_WHOLE = {"type": "integer", "minimum": 0}
_READ: Mapping[Callable[..., Any], JsonSchemaValue] = {
    read_both: {"anyOf": [_NUMBER, {"type": "array", "items": _NUMBER, "minItems": 2, "maxItems": 2}]},
    study.read_tasks: _NAMES,
    study.read_choices: _NAMES,
    study.read_executor: _TEXT,
    study.read_logs: _NAMES,
    study.read_seeds: {"anyOf": [_WHOLE, _TEXT, {"type": "array", "items": _WHOLE}]},
    accidents_of: _NAMES,
}
"""What a file has where a function of ours reads it."""


class _Schema(GenerateJsonSchema):
    def function_before_schema(self, schema: core_schema.BeforeValidatorFunctionSchema) -> JsonSchemaValue:
        return dict(_READ.get(schema["function"]["function"]) or super().function_before_schema(schema))

    def function_plain_schema(self, schema: core_schema.PlainValidatorFunctionSchema) -> JsonSchemaValue:
        return dict(_TEXT)  # formulas are the only values that `Read` reads


def json_schema(kind: Kind) -> JsonSchemaValue:
    """Of `task.yaml`, or of the file that `stlbench run FILE` takes."""
    if kind == "study":
        schema = study.Study.model_json_schema(schema_generator=_Schema)
        del schema["required"]  # the command line may say what the file leaves out
    else:
        schema = TaskFile.model_json_schema(schema_generator=_Schema)
        parts = {"TaskFile": schema, **schema["$defs"]}
        for model in _models(Entry):
            known = parts.get(model.__name__, {}).get("properties", {})
            for name in known.keys() & (docs := field_docs(model)).keys():
                known[name].setdefault("description", docs[name])
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _models(base: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for model in base.__subclasses__():
        yield model
        yield from _models(model)
