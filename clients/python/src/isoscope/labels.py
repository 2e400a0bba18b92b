"""Labels: sample values that stand for a thing, such as an organ, with names and colours.

    body = client["body"]
    body.labels                                 # (Label(value=3.0, name='left lung', color='#dcd814'), ...)
    body.render(labels=[3, "right lung"])       # a surface each
    body.render(labels=[(3, "right lung")])     # one surface of both
    body.render(labels="all")
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Union

from isoscope.errors import InvalidArgumentError

__all__ = ["MAX_LABELS_PER_SURFACE", "Label", "LabelLike", "LabelsLike", "label_color"]

#: The most values of one surface.
MAX_LABELS_PER_SURFACE = 256

#: The colours of labels that have none, by floor(value) modulo 16: those of the programs (docs/labels.md).
_PALETTE = (
    "#fe8677", "#2a89e2", "#d0dc51", "#ec83d4", "#0a999d", "#fec493", "#a4a2fe", "#339f46",
    "#febdc7", "#18bdfa", "#9f840d", "#ebbdfd", "#0cc9af", "#d35e2e", "#bad1ff", "#94bf41",
)  # fmt: skip


def label_color(value: float) -> str:
    """Returns the colour of a label that has none of its own, "#rrggbb"."""
    return _PALETTE[math.floor(value) % len(_PALETTE)]


@dataclass(frozen=True)
class Label:
    """A sample value with a name.

    Attributes:
        value: of the samples, field units.
        name: for people; None if the dataset has none.
        color: "#rrggbb"; None if the dataset has none: then surfaces get `label_color(value)`.
    """

    value: float
    name: str | None = None
    color: str | None = None


#: A label by its value, by its name, or as it stands in `Dataset.labels`.
LabelLike = Union[Label, float, str]
#: Surfaces of labels: each element is one surface; a tuple or list within is one surface of several labels.
LabelsLike = Union[LabelLike, Sequence[Union[LabelLike, Sequence[LabelLike]]]]


def as_label_sets(labels: LabelsLike) -> list[Sequence[LabelLike]]:
    """Returns a set of labels for each surface."""
    if isinstance(labels, (str, Label)) or not isinstance(labels, Iterable):
        return [[labels]]
    return [as_labels(one) for one in labels]


def as_labels(labels: LabelLike | Sequence[LabelLike]) -> Sequence[LabelLike]:
    """Returns the labels of one surface."""
    if isinstance(labels, (str, Label)) or not isinstance(labels, Iterable):
        return [labels]
    return list(labels)


def values_of(labels: LabelLike | Sequence[LabelLike], known: Sequence[Label]) -> tuple[float, ...]:
    """Returns the values of the labels of one surface, ascending, each once. `known` has the names."""
    values = sorted({_value_of(label, known) for label in as_labels(labels)})
    if not 1 <= len(values) <= MAX_LABELS_PER_SURFACE:
        raise InvalidArgumentError(
            f"labels: a surface has {len(values)} values; it must be 1 to {MAX_LABELS_PER_SURFACE}"
        )
    return tuple(values)


def color_of(values: Sequence[float], known: Sequence[Label]) -> str:
    """Returns the colour of a surface of these values: that of the first."""
    found = next((label for label in known if label.value == values[0]), None)
    return found.color if found is not None and found.color is not None else label_color(values[0])


def _value_of(label: LabelLike, known: Sequence[Label]) -> float:
    if isinstance(label, Label):
        return label.value
    if isinstance(label, str):
        return _value_of_name(label, known)
    try:
        value = float(label) + 0.0
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"label {label!r}: must be a value or a name") from error
    if not math.isfinite(value):
        raise InvalidArgumentError(f"label {label!r}: must be finite")
    return value


def _value_of_name(name: str, known: Sequence[Label]) -> float:
    exact = [label.value for label in known if label.name == name]
    found = exact or [label.value for label in known if label.name and label.name.lower() == name.lower()]
    if len(found) > 1:
        raise InvalidArgumentError(f"label {name!r}: {', '.join(f'{value:g}' for value in found)} have this name")
    if found:
        return found[0]
    names = [label.name for label in known if label.name]
    if not names:
        raise InvalidArgumentError(f"label {name!r}: the dataset has no names of labels; give values")
    nearest = difflib.get_close_matches(name, names, 1)
    hint = f", did you mean {nearest[0]!r}?" if nearest else ""
    raise InvalidArgumentError(f"label {name!r}: there is none of this name{hint}; Dataset.labels has {len(names)}")
