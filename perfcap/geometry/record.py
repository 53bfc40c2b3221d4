"""Frozen dataclasses of tensors, taken as one value: mapped, stacked, chosen from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any, Self

import torch
from torch import Tensor
from torch.utils._pytree import register_pytree_node


class Record:
    """Base of frozen dataclasses whose fields are tensors, mappings of tensors, or None.

    Everything else a field may hold is kept as it is. Two records of one kind fit each other when
    they have the same tensors. Records are pytrees: ``torch.func`` transforms take and return them.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        register_pytree_node(cls, _flatten, partial(_unflatten, cls))

    def map(self, function: Callable[..., Tensor], *others: Self) -> Self:
        """A function of every tensor, and of its fellows in other records.

        Raises:
            ValueError: another record has a tensor where this one has none, or the reverse.
        """
        changed = {
            name: _mapped(name, function, *(getattr(each, name) for each in (self, *others)))
            for name in _tensor_fields(type(self))
        }
        return replace(self, **changed)  # type: ignore[type-var]

    def where(self, mask: Tensor, other: Self) -> Self:
        """These tensors where a mask over their leading axes is true, the other's elsewhere."""

        def pick(own: Tensor, others: Tensor) -> Tensor:
            return torch.where(
                mask.reshape(*mask.shape, *[1] * (own.ndim - mask.ndim)), own, others
            )

        return self.map(pick, other)

    def detach(self) -> Self:
        """The same numbers without a graph."""
        return self.map(Tensor.detach)

    @classmethod
    def stack(cls, records: Sequence[Self]) -> Self:
        """Records of one kind and size along a new first axis."""
        return records[0].map(lambda *each: torch.stack(each), *records[1:])

    @classmethod
    def cat(cls, records: Sequence[Self]) -> Self:
        """Records of one kind along their first axis."""
        return records[0].map(lambda *each: torch.cat(each), *records[1:])


Context = tuple[list[str], dict[str, Any]]


def _flatten(record: Record) -> tuple[list[Any], Context]:
    """What of a record transforms see, its names, and what they leave alone."""
    given = {
        field.name: getattr(record, field.name)
        for field in fields(record)  # type: ignore[arg-type]
        if field.init
    }
    seen = [name for name in _tensor_fields(type(record)) if given[name] is not None]
    return [given.pop(name) for name in seen], (seen, given)


def _unflatten(kind: type[Record], values: Iterable[Any], context: Context) -> Record:
    """The record again; transforms may put anything in the place of tensors, unchecked."""
    record = object.__new__(kind)
    seen, kept = context
    given = dict(zip(seen, values, strict=True)) | kept
    for field in fields(kind):  # type: ignore[arg-type]
        fresh: Any = field.default_factory  # what is not given to a record is made by it
        object.__setattr__(record, field.name, given[field.name] if field.init else fresh())
    return record


def _tensor_fields(kind: type[Record]) -> tuple[str, ...]:
    """Fields that are declared to hold tensors, whatever they hold now."""
    declared = fields(kind)  # type: ignore[arg-type]
    return tuple(f.name for f in declared if f.init and "Tensor" in str(f.type))


def _mapped(name: str, function: Callable[..., Tensor], own: Any, *others: Any) -> Any:
    """A field of a record, mapped."""
    if isinstance(own, Mapping):
        if any(list(each) != list(own) for each in others):
            raise ValueError(f"records differ in the blocks of {name}: {[list(own), *others]}")
        return {key: function(own[key], *(each[key] for each in others)) for key in own}
    if any((each is None) != (own is None) for each in others):
        raise ValueError(f"only some of the records have {name}; give it to all or to none")
    return None if own is None else function(own, *others)
