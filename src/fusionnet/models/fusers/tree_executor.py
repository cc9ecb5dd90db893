"""What is said, carried out on what is seen, one entity of the tree after the other.

Every entity becomes a soft set: for each of the 512 cells, how likely it is what the
words mean. The structure is given, the meaning is learned:

- a colour or a type is a learned preference for the 16 classes;
- an attribute (type, indicator, cardinal, role and their pairs) demands, by learned
  gates, what is true of a cell: nothing on top, the same colour below, ...; a place has
  a learned map of the board, and an indicator a learned ranking for "the leftmost" among several;
- a relation is a learned set of displacements from its landmark, within the reach of one
  square or of its measure, and "nearest" ranks by a learned distance, which begins as the
  straight one.

Demands are joined as a soft "and" (sums of log probabilities), relations to a set as a
soft "or" over its members, and the best of several is chosen with the probability that
no better one exists. So an unlikely block never outweighs a likely one, whatever its
place: that keeps the executor right on layouts read with doubt.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn.functional import embedding_bag, logsigmoid

from fusionnet.blocks.grid import GRID
from fusionnet.models.program_pack import NOTHING, PackedLevel, PackedPrograms, PackedRelations
from fusionnet.models.program_values import ATTRIBUTES, RANKINGS, RELATIONS, Goal, Held, Kind
from fusionnet.models.soft_layout import (
    CELLS,
    CLASSES,
    COLORS,
    COLUMNS,
    FLOOR,
    SoftLayout,
)

SPAN = 2 * GRID - 1
"""Displacements along one axis: -7 to 7."""

NEVER = -20.0
"""Logit of a displacement beyond a relation's reach."""

BEND = 0.1
"""Squares by which a unit of the learned parameters bends the straight distance."""

CANDIDATES = 64
"""Members of a soft set that are looked at in pairs: the board's columns, at most."""

TRUTHS = (
    "matches",
    "clear",
    "bottom",
    "alone",
    "topmost cube",
    "below matches",
    "above matches",
    "all down match",
    "has each colour from here down",
    "cube",
    "cube below",
    "moved",
)
"""What the gates may demand of a cell, or of its absence."""


@dataclass(frozen=True)
class Execution:
    """What the executor found for each example.

    Attributes:
        source: Log probabilities of the cell that the block is taken from.
        target: Log probabilities of the cell where it goes.
        steps: For each step of the pack, log of how likely each cell belongs to it.
        found: Log likelihood of the likeliest cell of each step, then of each example's place.
        usual: What `found` is at least, usually, where the command can be executed.
        example: The example that each of them belongs to.
    """

    source: Float[Tensor, "b 512"]
    target: Float[Tensor, "b 512"]
    steps: Float[Tensor, "n 512"]
    found: Float[Tensor, " m"]
    usual: Float[Tensor, " m"]
    example: Int[Tensor, " m"]

    @property
    def evidence(self) -> Float[Tensor, " b"]:
        """How likely the layout has all that each example speaks of, 0 to 1."""
        lacking = (self.found - self.usual).clamp(max=0)
        none = lacking.new_zeros(len(self.source))
        return none.index_add(0, self.example, lacking).exp()


class TreeExecutor(nn.Module):
    """Ground programs in soft layouts; see the module's docstring."""

    def __init__(self) -> None:
        super().__init__()
        attributes, relations = len(ATTRIBUTES), len(RELATIONS)
        own = torch.eye(COLORS).repeat(1, CLASSES // COLORS)
        self.color_classes = nn.Parameter(4 * own - 2)
        self.type_classes = nn.Parameter(torch.zeros(attributes, CLASSES))
        self.demands = nn.Parameter(torch.zeros(attributes, 2 * len(TRUTHS)))
        bias = torch.full((2 * len(TRUTHS),), -3.0)
        bias[TRUTHS.index("matches")] = 3.0
        self.demand_bias = nn.Parameter(bias)
        self.area = nn.Parameter(torch.zeros(attributes, COLUMNS))
        self.area_lines = nn.Parameter(torch.zeros(attributes, 2, GRID))
        self.level = nn.Parameter(torch.full((attributes, GRID), 3.0))
        self.order = nn.Parameter(torch.zeros(attributes, 3 * GRID))
        self.offset_levels = nn.Parameter(torch.zeros(relations, SPAN))
        ahead = torch.arange(SPAN) - (GRID - 1)
        straight = torch.hypot(ahead[:, None].float(), ahead.float()).flatten()
        reach = torch.tensor([max(1, measure) + 0.5 for _, measure, _, _ in RELATIONS])
        beyond = straight > reach[:, None]
        self.register_buffer("beyond", beyond, persistent=False)
        self.offsets = nn.Parameter(torch.full((relations, SPAN**2), -1.0))
        self.register_buffer("straight", straight, persistent=False)
        self.bend = nn.Parameter(torch.zeros(len(RANKINGS), SPAN**2))
        self.ranking = nn.Parameter(torch.tensor([30.0, 3.0, 3.0]).log())
        self.usual = nn.Parameter(torch.zeros(attributes, 1))
        self.usual_place = nn.Parameter(torch.zeros(len(Goal)))
        self.lift = nn.Parameter(torch.zeros(GRID, GRID))
        place = torch.arange(COLUMNS)
        step = torch.stack([place // GRID, place % GRID])
        ahead = step[:, None, :] - step[:, :, None] + GRID - 1
        self.register_buffer("column_steps", ahead[0] * SPAN + ahead[1], persistent=False)
        level = torch.arange(GRID)
        rise = level[None, :] - level[:, None] + GRID - 1
        self.register_buffer("level_steps", rise, persistent=False)
        robot = torch.zeros(CELLS)
        robot[: GRID**2 : GRID] = 1.0
        self.register_buffer("robot", robot, persistent=False)
        ground = (torch.arange(CELLS) % GRID == 0).float()
        self.register_buffer("ground", ground, persistent=False)

    beyond: Tensor
    straight: Tensor
    column_steps: Tensor
    level_steps: Tensor
    robot: Tensor
    ground: Tensor

    def forward(self, programs: PackedPrograms, layout: SoftLayout) -> Execution:
        """Run programs, each in its own layout of the batch."""
        done: list[Tensor] = []
        found = layout.held.new_zeros(0, CELLS)
        for level in programs.levels:
            done.append(self._ground(level, layout, found))
            found = torch.cat(done)
        source = found[programs.source].log_softmax(1)
        place = self._target(programs, layout, source, found)
        usual = [_bag(self.usual, (p.attributes, p.attribute_offsets)) for p in programs.levels]
        return Execution(
            source=source,
            target=place.log_softmax(1),
            steps=found,
            found=torch.cat([found.amax(1), place.amax(1)]),
            usual=torch.cat([*(u[:, 0] for u in usual), self.usual_place[programs.goal]]),
            example=torch.cat([*(p.example for p in programs.levels), _numbers(programs.goal)]),
        )

    def _ground(
        self, level: PackedLevel, layouts: SoftLayout, found: Float[Tensor, "k 512"]
    ) -> Float[Tensor, "n 512"]:
        """Log probability of each cell to be in the set of each step of one level."""
        layout = layouts.select(level.example)
        moved = _rows_or_nothing(found, level.moved)
        bag = (level.attributes, level.attribute_offsets)
        standing = layout.standing
        either = layout.held + (1 - layout.holding)[:, None] * standing
        held = level.held[:, None]
        things = torch.where(held == Held.YES, layout.held, standing)
        things = torch.where(held == Held.IF_ANY, either, things)
        gates = self._gates(level, layout, moved, bag)
        place = level.kind >= Kind.PLACE
        ground = torch.where((level.kind == Kind.ROBOT)[:, None], self.robot, self.ground)
        log_set = torch.where(place[:, None], _log(ground), _log(things) + gates)
        lines = (self.area_lines[:, 0, :, None] + self.area_lines[:, 1, None]).flatten(1)
        area = _bag(logsigmoid(self.area + lines), bag)
        height = _bag(logsigmoid(self.level), bag)
        area = torch.where(place[:, None], area, 0.0)
        height = torch.where(place[:, None], 0.0, height)
        log_set = log_set + _over_cells(area, height)
        if len(level.relations.subject):
            log_set = log_set + self._related(level.relations, len(log_set), found)
            rows, near = self._near(level.relations, found)
            log_set = log_set.index_add(0, rows, self._none_better(log_set[rows], near))
        rows = level.ranks.nonzero()[:, 0]
        if len(rows):
            x, y, z = _bag(self.order, bag).unflatten(1, (3, GRID)).unbind(1)
            order = _over_cells((x[:, :, None] + y[:, None]).flatten(1), z)
            log_set = log_set.index_add(0, rows, self._none_better(log_set[rows], order[rows]))
        return log_set

    def _gates(
        self,
        level: PackedLevel,
        layout: SoftLayout,
        moved: Float[Tensor, "n 512"],
        bag: tuple[Tensor, Tensor],
    ) -> Float[Tensor, "n 512"]:
        """Sum of log probabilities that the demands of each step are met in each cell."""
        truths = self._truths(level, layout, moved, bag)
        demands = (_bag(self.demands, bag) + self.demand_bias).sigmoid()[:, :, None]
        wanted, unwanted = demands.split(len(TRUTHS), dim=1)
        truths = truths.clamp(0, 1)
        missing = wanted * (1 - truths) + unwanted * truths
        return (-missing.clamp(max=1 - FLOOR)).log1p().sum(1)

    def _truths(
        self,
        level: PackedLevel,
        layout: SoftLayout,
        moved: Float[Tensor, "n 512"],
        bag: tuple[Tensor, Tensor],
    ) -> Float[Tensor, "n t 512"]:
        """How true each of `TRUTHS` is of each cell, given that the cell is filled."""
        rows = len(moved)
        preferences = self.color_classes.sigmoid()
        colors = torch.cat([preferences, torch.zeros_like(preferences[:1])])[level.colors]
        any_color = 1 - (1 - colors).prod(1)
        colorless = (level.colors == NOTHING).all(1)
        any_color = torch.where(colorless[:, None], 1.0, any_color)
        wanted = any_color * _bag(logsigmoid(self.type_classes), bag).exp()
        in_color = _columns(torch.einsum("nic,nc->ni", layout.classes, any_color))
        matches = _columns(torch.einsum("nic,nc->ni", layout.classes, wanted))
        top, standing = _columns(layout.top), _columns(layout.standing)
        hanging = _columns(layout.held)
        clear = (top + hanging) / (standing + hanging).clamp(min=FLOOR)
        clear = clear.clamp(0, 1)
        zero = torch.zeros_like(matches[:, :, :1])
        bottom = torch.zeros_like(matches)
        bottom[:, :, 0] = 1
        cube = _columns(layout.classes[:, :, :COLORS].sum(2))
        below_prism = torch.cat([1 - cube[:, :, 1:], zero + 1], dim=2)
        share = torch.einsum("nic,nkc->nki", layout.classes, colors)
        absent = (1 - share).unflatten(2, (COLUMNS, GRID)).cumprod(3).flatten(2)
        has_each = torch.where((level.colors == NOTHING)[:, :, None], 1.0, 1 - absent).prod(1)
        truths = (
            matches,
            clear,
            bottom,
            bottom * clear,
            cube * (clear + (1 - clear) * below_prism),
            torch.cat([zero, in_color[:, :, :-1]], dim=2),
            (1 - clear) * torch.cat([in_color[:, :, 1:], zero], dim=2),
            in_color.cumprod(2),
            _columns(has_each),
            cube,
            torch.cat([zero, cube[:, :, :-1]], dim=2),
            _columns(moved),
        )
        return torch.stack(truths, dim=1).view(rows, len(TRUTHS), CELLS)

    def _related(
        self, relations: PackedRelations, rows: int, found: Float[Tensor, "k 512"]
    ) -> Float[Tensor, "n 512"]:
        """Log probability that each cell stands in the relation to a member of the landmark."""
        result = found.new_zeros(rows, CELLS)
        which = (~relations.ranks).nonzero()[:, 0]
        if not len(which):
            return result
        number = relations.number[which]
        log_member, cell = _members(found[relations.landmark[which]])
        offsets = self.offsets[number].masked_fill(self.beyond[number], NEVER)
        across = self._displaced(offsets, self.column_steps, cell // GRID)
        along = self._displaced(self.offset_levels[number], self.level_steps, cell % GRID)
        member = log_member.exp()[:, :, None] * across.sigmoid()
        none = (-(member[..., None] * along.sigmoid()[:, :, None]).clamp(max=1 - FLOOR)).log1p()
        related = _log(-torch.expm1(none.sum(1)).flatten(1))
        return result.index_add(0, relations.subject[which], related)

    def _near(
        self, relations: PackedRelations, found: Float[Tensor, "k 512"]
    ) -> tuple[Int[Tensor, " r"], Float[Tensor, "r 512"]]:
        """The rows that are ranked by nearness, and how near each cell is to the landmark.

        The distance to a soft set is that to its nearest member: each member counts with
        the probability that it is in the set while none that is nearer is.
        """
        which = relations.ranks.nonzero()[:, 0]
        log_member, cell = _members(found[relations.landmark[which]])
        table = self.straight + BEND * self.bend[relations.number[which]]
        away = self._displaced(table, self.column_steps, cell // GRID)
        away, order = away.sort(dim=1)
        member = log_member.exp()[:, :, None].expand_as(away).gather(1, order)
        log_none = (-member.clamp(max=1 - FLOOR)).log1p()
        log_first = _log(member) + log_none.cumsum(1) - log_none
        sharpness, decision = self.ranking[:2].exp()
        weight = ((1 + decision) * log_first).softmax(1)
        nearness = -sharpness * (weight * away).sum(1)
        return relations.subject[which], nearness.repeat_interleave(GRID, dim=1)

    def _none_better(
        self, log_set: Float[Tensor, "n 512"], ranking: Float[Tensor, "n 512"]
    ) -> Float[Tensor, "n 512"]:
        """Log probability that no member of the set ranks above each cell."""
        log_member, cell = _members(log_set)
        member = log_member.exp().clamp(max=1 - FLOOR)
        value = ranking.gather(1, cell)
        better = (value[:, None] - value[:, :, None] - self.ranking[2].exp()).sigmoid()
        other = 1 - torch.eye(CANDIDATES, device=member.device)
        none = (-member[:, None] * better * other).log1p().sum(2)
        return torch.zeros_like(log_set).scatter(1, cell, none)

    def _displaced(
        self,
        table: Float[Tensor, "m s"],
        steps: Int[Tensor, "p q"],
        place: Int[Tensor, "m k"],
    ) -> Float[Tensor, "m k q"]:
        """Values of a table of displacements from each member's place to all places."""
        index = steps[place].flatten(1)
        return table.gather(1, index).view(*place.shape, steps.shape[1])

    def _target(
        self,
        programs: PackedPrograms,
        layouts: SoftLayout,
        source: Float[Tensor, "b 512"],
        found: Float[Tensor, "n 512"],
    ) -> Float[Tensor, "b 512"]:
        """Log likelihood of each cell as the place."""
        column = source.exp().unflatten(1, (COLUMNS, GRID))
        from_column = column.sum(2, keepdim=True).expand_as(column).flatten(1)
        target = _log(layouts.landing)
        down = target + _log(from_column)
        lift = _log((column @ self.lift.softmax(1)).flatten(1))
        if len(programs.destination.subject):
            related = self._related(programs.destination, len(target), found)
            stood = 1 - torch.where(programs.held == Held.YES, 1.0, layouts.holding)
            stood = torch.where(programs.held == Held.NO, 1.0, stood)
            target = target + related + _log(1 - from_column * stood[:, None])
        goal = programs.goal[:, None]
        target = torch.where(goal == Goal.DOWN, down, target)
        return torch.where(goal == Goal.LIFT, lift, target)


def _members(
    log_set: Float[Tensor, "m 512"],
) -> tuple[Float[Tensor, "m k"], Int[Tensor, "m k"]]:
    """The likeliest members of each set, relative to the likeliest one, and their cells."""
    log_member, cell = log_set.topk(CANDIDATES, dim=1)
    return log_member - log_member[:, :1], cell


def _numbers(rows: Tensor) -> Int[Tensor, " n"]:
    return torch.arange(len(rows), device=rows.device)


def _columns(cells: Float[Tensor, "n 512"]) -> Float[Tensor, "n 64 8"]:
    return cells.unflatten(1, (COLUMNS, GRID))


def _over_cells(
    across: Float[Tensor, "n 64"], along: Float[Tensor, "n 8"]
) -> Float[Tensor, "n 512"]:
    """The sum of a value a column and a value a level, for each cell."""
    return (across[:, :, None] + along[:, None, :]).flatten(1)


def _bag(table: Float[Tensor, "a w"], bag: tuple[Tensor, Tensor]) -> Float[Tensor, "n w"]:
    """Sum of the rows of a table that belong to each step."""
    return embedding_bag(bag[0], table, bag[1], mode="sum")


def _rows_or_nothing(
    found: Float[Tensor, "k 512"], rows: Int[Tensor, " n"]
) -> Float[Tensor, "n 512"]:
    """Normalised sets of some steps; zero where there is none."""
    nothing: Bool[Tensor, " n"] = rows == NOTHING
    if bool(nothing.all()):
        return found.new_zeros(len(rows), CELLS)
    return torch.where(nothing[:, None], 0.0, found[rows.clamp(min=0)].softmax(1))


def _log(probability: Tensor) -> Tensor:
    return (probability.clamp(min=0) + FLOOR).log()
