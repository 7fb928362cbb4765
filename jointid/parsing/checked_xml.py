"""XML files under limits: no document type, no entities, so that nothing expands or is fetched."""

import math
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from jointid.errors import JointIdError
from jointid.wording import shown

_MAX_DEPTH = 200
_MAX_ELEMENTS = 5_000


def parse_xml(file: str, data: bytes, root: str) -> Element:
    """Parse an XML file whose outermost element is ``root``; comments are dropped.

    Raises JointIdError when it is not XML, has a document type or another root, or too many or too
    deeply nested elements.
    """
    parser, builder, depth, elements = expat.ParserCreate(), TreeBuilder(), 0, 0

    def fail(message: str) -> JointIdError:
        line = parser.CurrentLineNumber
        return JointIdError(f"{file}, line {line}: {message}", file=file, line=line)

    def refuse(*_: object) -> None:
        raise fail("a robot model must not have a document type or an entity: remove <!DOCTYPE …>.")

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth, elements
        depth, elements = depth + 1, elements + 1
        if elements > _MAX_ELEMENTS:
            raise fail(f"more than {_MAX_ELEMENTS} elements: remove visual and unused ones.")
        if depth > _MAX_DEPTH:
            raise fail(f"elements are nested more than {_MAX_DEPTH} levels deep.")
        if depth == 1 and tag != root:
            raise fail(f"the outermost element is <{tag[:60]}>: expected <{root}>.")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        if isinstance(error, JointIdError):
            raise
        raise fail(f"not valid XML: {error!s:.200}.") from error
    return builder.close()


def require_numbers(file: str, place: str, text: str, count: range) -> list[float]:
    """Return the finite numbers of an attribute, separated by spaces.

    Raises JointIdError when one is no finite number, or their count is not in ``count``.
    """
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = [math.nan]
    if len(values) not in count or not all(map(math.isfinite, values)):
        wanted = str(count[0]) if len(count) == 1 else f"{count[0]} to {count[-1]}"
        raise JointIdError(
            f"{file}, {place} = {shown(text)}: expected {wanted} finite "
            f"{'number' if wanted == '1' else 'numbers'}.",
            file=file,
        )
    return values
