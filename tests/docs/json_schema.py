# SPDX-License-Identifier: MIT
"""As much of JSON Schema (draft 7) as our schemas use, and one thing more: with `closed`, a key that the schema does not name is a
complaint too."""
import re

KINDS = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}


def is_a(value, kind):
    if kind in ("number", "integer"):
        return isinstance(value, (int, float)) and not isinstance(value, bool) and (kind == "number" or value == int(value))
    return isinstance(value, KINDS[kind])


def complaints(schema, value, root=None, where="", closed=False):
    """Sentences, a schema's objection each; none: the document is as the schema says."""
    root = root or schema
    if "$ref" in schema:
        part = root
        for name in schema["$ref"].removeprefix("#/").split("/"):
            part = part[name]
        return complaints(part, value, root, where, closed)
    out, here = [], where or "the document"
    for choice in ("anyOf", "oneOf"):
        if choice in schema and not any(not complaints(each, value, root, where, closed) for each in schema[choice]):
            out.append(f"{here} is none of what it may be")
    for each in schema.get("allOf", []):
        out += complaints(each, value, root, where, closed)
    kinds = schema.get("type", [])
    kinds = kinds if isinstance(kinds, list) else [kinds]
    if kinds and not any(is_a(value, kind) for kind in kinds):
        return out + [f"{here} is no {' or '.join(kinds)}"]
    if "const" in schema and value != schema["const"] or "enum" in schema and value not in schema["enum"]:
        out.append(f"{here} is {value!r}")
    if is_a(value, "number") and not schema.get("minimum", value) <= value <= schema.get("maximum", value):
        out.append(f"{here} is out of its range")
    if isinstance(value, str) and "pattern" in schema and not re.search(schema["pattern"], value):
        out.append(f"{here} is not like {schema['pattern']}")
    if isinstance(value, list):
        if len(value) < schema.get("minItems", 0):
            out.append(f"{here} is too short")
        for number, item in enumerate(value):
            out += complaints(schema.get("items", {}), item, root, f"{where}[{number}]", closed)
    if isinstance(value, dict):
        named = schema.get("properties", {})
        out += [f"{here} lacks '{key}'" for key in schema.get("required", []) if key not in value]
        out += [f"{here}: the schema does not know '{key}'" for key in value if key not in named and named and
                (closed or schema.get("additionalProperties") is False)]
        for key, each in value.items():
            out += complaints(named.get(key, {}), each, root, f"{where}.{key}".lstrip("."), closed)
    return out
