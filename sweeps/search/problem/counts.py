"""Numbers of LiDARs by zone and model that keep all bounds: listed, and the nearest to a wish."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cache

from lidarplace.base.errors import InputError
from lidarplace.mounting.counts import CountBound
from sweeps.search.problem.slots import MountSlot

MOST_COUNTS = 10_000
"""Most ways to divide LiDARs among zones."""
CountsPerZone = tuple[int, ...]
"""Numbers of LiDARs to place: in all zones together, or in each zone.

A mirrored pair of a zone counts once."""
Group = Mapping[int, Sequence[MountSlot]]
"""Slots that are counted together, by their number."""
Sums = frozenset[tuple[int, ...]]
"""Numbers of LiDARs that each of several bounds counts, one tuple a choice of models."""


def count_all(groups: Sequence[Group], bounds: Sequence[CountBound]) -> tuple[CountsPerZone, ...]:
    """List the counts of all groups that some choice of models lets keep all bounds.

    Fewest LiDARs first. `bounds`: the total, then those of models. Raises InputError: there are no
    such counts, or too many."""
    total, *_ = bounds
    ways = Counter({0: 1})
    for group in groups:
        sizes = Counter(_size(slots) for slots in group.values())
        ways = sum(
            (Counter({n + size: of * w for n, w in ways.items()}) for size, of in sizes.items()),
            Counter(),
        )
    number = sum(way for size, way in ways.items() if total.allows(size))
    if not number:
        raise _impossible(total, ways.keys() - {0}, "impossible with the numbers of the zones")
    if number > MOST_COUNTS:
        most, fix = f"at most {MOST_COUNTS:,}", "set ranges of `lidars` in fewer zones"
        problem, key = "too many ways to divide LiDARs", "search.zones"
        raise InputError(problem, key=key, expected=most, found=f"{number:,}", fix=fix)
    counts = possible_counts(groups, bounds)
    if not counts:
        raise _first_impossible(groups, bounds)
    sizes_of = {
        each: sum(_size(group[n]) for group, n in zip(groups, each, strict=True)) for each in counts
    }
    return tuple(sorted(counts, key=lambda each: (sizes_of[each], each)))


def nearest_models(
    slots: Sequence[MountSlot], wanted: Sequence[str], bounds: Sequence[CountBound]
) -> tuple[str, ...] | None:
    """Return a model for each slot that keep all bounds, as few as possible other than `wanted`.

    None if no choice of models keeps them."""
    best: dict[tuple[int, ...], tuple[int, tuple[str, ...]]] = {(0,) * len(bounds): (0, ())}
    for slot, wish in zip(slots, wanted, strict=True):
        further: dict[tuple[int, ...], tuple[int, tuple[str, ...]]] = {}
        for before, (changes, models) in best.items():
            for model in slot.models:
                after, cost = _plus(before, slot.size, model, bounds), changes + (model != wish)
                if after is not None and (after not in further or cost < further[after][0]):
                    further[after] = cost, (*models, model)
        best = further
    choices = (choice for sums, choice in best.items() if _keep(sums, bounds))
    return min(choices, key=lambda choice: choice[0], default=(0, None))[1]


def possible_counts(
    groups: Sequence[Group], bounds: Sequence[CountBound]
) -> dict[CountsPerZone, Sums]:
    """Return counts of groups that can keep all bounds, with the sums that do."""

    @cache
    def with_slots(before: Sums, kinds: tuple[tuple[int, tuple[str, ...]], ...]) -> Sums:
        for size, models in kinds:
            sums = (_plus(each, size, model, bounds) for each in before for model in models)
            before = frozenset(each for each in sums if each is not None)
        return before

    counts: dict[CountsPerZone, Sums] = {(): frozenset([(0,) * len(bounds)])}
    for group in groups:
        kinds = {n: tuple((slot.size, slot.models) for slot in group[n]) for n in group}
        counts = {
            (*before, n): sums
            for before, sums_before in counts.items()
            for n, kinds_of_slots in kinds.items()
            if (sums := with_slots(sums_before, kinds_of_slots))
        }
    possible = {
        each: frozenset(numbers for numbers in sums if _keep(numbers, bounds))
        for each, sums in counts.items()
    }
    return {each: sums for each, sums in possible.items() if sums}


def _plus(
    before: tuple[int, ...], size: int, model: str, bounds: Sequence[CountBound]
) -> tuple[int, ...] | None:
    """Add so many LiDARs of a model to the sums of bounds; None if one is exceeded."""
    after = tuple(
        number + (size if bound.model in (None, model) else 0)
        for number, bound in zip(before, bounds, strict=True)
    )
    exceeds = any(n > bound.high for n, bound in zip(after, bounds, strict=True))
    return None if exceeds else after


def _keep(sums: Sequence[int], bounds: Sequence[CountBound]) -> bool:
    return all(bound.allows(n) for n, bound in zip(sums, bounds, strict=True))


def _size(slots: Sequence[MountSlot]) -> int:
    return sum(slot.size for slot in slots)


def _first_impossible(groups: Sequence[Group], bounds: Sequence[CountBound]) -> InputError:
    """Return the error of the first bound that no rig keeps together with those before it."""
    for number, bound in enumerate(bounds):
        open_bound = replace(bound, low=0, high=sum(_size(group[max(group)]) for group in groups))
        possible = possible_counts(groups, [*bounds[:number], open_bound]).values()
        numbers = {sums[number] for every in possible for sums in every}
        if not any(map(bound.allows, numbers)):
            return _impossible(bound, numbers, "impossible with the other numbers")
    raise AssertionError


def _impossible(bound: CountBound, numbers: Collection[int], text: str) -> InputError:
    """Return the error of a bound; `numbers`: what a rig can have instead."""
    low, *rest = sorted(numbers)
    high = rest[-1] if rest else low
    together = high - low == len(rest)
    expected = f"{low} to {high}" if rest and together else ", ".join(map(str, [low, *rest]))
    fix = "change it, or a number of a zone or a model"
    return InputError(text, key=f"search.{bound.key}", expected=expected, found=bound.text, fix=fix)
