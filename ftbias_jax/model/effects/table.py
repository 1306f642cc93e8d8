"""A table of effects, and values that belong to a table with more than the built-in ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import jax.tree_util

from ftbias_jax.model.effects.types import Effect, EffectValues, Values


class Catalogue(Mapping[str, Effect]):
    """Name -> effect, in the order in which they act; equal to another one if it is made of the same entries."""

    def __init__(self, effects: Iterable[Effect], own: tuple[Effect, ...] = ()) -> None:
        self._entries = {effect.name: effect for effect in effects}
        self.own = own
        """Those that the caller has brought."""

    def __getitem__(self, name: str) -> Effect:
        return self._entries[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __repr__(self) -> str:
        """The built-in effects by name: what the caller brought is told from others by nothing but where it is."""
        return object.__repr__(self) if self.own else f"Catalogue({', '.join(self)})"

    # Functions compiled for one catalogue serve another one of the same entries, which are compared by identity.

    def __hash__(self) -> int:
        return hash(tuple(map(id, self._entries.values())))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Catalogue) or len(self) != len(other):
            return False
        return all(mine is its for mine, its in zip(self.values(), other.values(), strict=True))

    def searched_by(self, *searches: type) -> tuple[Effect, ...]:
        """The entries whose fit is searched in one of these ways, classes of ``fitting``."""
        return tuple(effect for effect in self.values() if isinstance(effect.fit.search, searches))

    def adding(self, own: Iterable[Effect]) -> Catalogue:
        """The catalogue with further effects, each after the first ones of its stage."""
        own = tuple(own)
        entries = list(self.values())
        for effect in own:
            stages = [entry.stage for entry in entries]
            first = stages.index(effect.stage)
            after = next((i for i in range(first, len(stages)) if stages[i] != effect.stage), len(stages))
            entries.insert(after, effect)
        return Catalogue(entries, (*self.own, *own))


@jax.tree_util.register_pytree_node_class
class OwnValues(dict[str, EffectValues]):
    """Values of effects some of which are not built in, with the catalogue that has them: the two travel together."""

    def __init__(self, values: Values, catalogue: Catalogue) -> None:
        super().__init__(values)
        self.catalogue = catalogue

    def tree_flatten(self) -> tuple[tuple[EffectValues, ...], tuple[tuple[str, ...], Catalogue]]:
        """For JAX: the values are its leaves, names and catalogue are part of what is compiled."""
        names = tuple(sorted(self))
        return tuple(self[name] for name in names), (names, self.catalogue)

    @classmethod
    def tree_unflatten(cls, known: tuple[tuple[str, ...], Catalogue], values: Iterable[EffectValues]) -> OwnValues:
        """The other way."""
        names, catalogue = known
        return cls(dict(zip(names, values, strict=True)), catalogue)
