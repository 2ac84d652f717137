"""A mapping of signals: files of episodes and clocks, and the channel of each column."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, PrivateAttr, model_validator

from slapshot.errors import InputError
from slapshot.recordings.channels import Channel, Name, check_channels
from slapshot.recordings.header import FreeText, Line, StandIn
from slapshot.recordings.importing.mapping import ColumnRef, CsvStyle, Files, Given, Number, ScaledColumn
from slapshot.recordings.importing.name_pattern import NamePattern
from slapshot.recordings.si import to_si
from slapshot.validation import LONGEST_NAME, Model, ProblemAtError, validated
from slapshot.yaml_file import Document, read_document

SIGNAL_KEYS = frozenset({"format_version", "channels", "clocks"})  # of which a mapping of tracks has none
ONLY_CLOCK = "main"
EPISODE = "<episode>"  # role of the column that identifies episodes
_LARGEST = 1e9


class Time(Model):
    """When the rows of a file were sampled."""

    column: Given[ColumnRef] = Field(
        default=None, description="name in the header, or number of the column from 0"
    )
    unit: str = Field(default="s", max_length=20, description="s, ms, us or ns")
    rate_hz: Given[Annotated[float, Field(gt=0, le=1e7)]] = Field(
        default=None, description="rows a second, where no column has times"
    )
    repeats: Literal["refuse", "keep_first", "keep_last"] = Field(
        default="refuse", description="what to do with rows of the same time"
    )

    @model_validator(mode="after")
    def _tells(self) -> Self:
        if (self.column is None) == (self.rate_hz is None):
            raise ValueError("give either the column of times, or rate_hz where there is none")
        si = to_si(self.unit)
        if si.unit != "s":
            raise ProblemAtError(("unit",), f"{self.unit!r} is no unit of time; write s, ms, us or ns")
        return self


class ClockFiles(Model):
    """Files that were written by one clock."""

    files: Files = Files()
    csv: CsvStyle = CsvStyle()
    time: Time
    episode: Given[ColumnRef] = Field(
        default=None,
        description="column that identifies the episodes of a file; without it a file is one episode",
    )


class ChannelColumn(Channel):
    """A channel and the column that it is from: value in `unit` = sign * scale * number + offset."""

    clock: Name = Field(
        default=ONLY_CLOCK, description="which of the clocks has it; not needed where there is one"
    )
    unit: Annotated[str, Field(max_length=LONGEST_NAME)] = Field(
        description="of the column: rad, deg, rev, m, mm, rad/s, N m, ...; counts are rev with a scale"
    )
    column: ColumnRef = Field(description="name in the header, or number of the column from 0")
    scale: Annotated[Number, Field(gt=0)] = Field(
        default=1.0, description="what to multiply by: a gear's ratio, or one over an encoder's counts"
    )
    sign: Literal[1, -1] = Field(default=1, description="-1 turns an axis round")
    offset: Number = Field(default=0.0, description="what to add after that, in the channel's unit")
    period: Given[Annotated[float, Field(gt=0, le=1e15, allow_inf_nan=False)]] = Field(
        default=None,
        description="of a position that wraps: after how much the column's numbers begin again, as 360",
    )

    def _check_unit(self) -> None:
        try:
            self.check_unit(to_si(self.unit).unit)
        except ValueError as error:
            raise ProblemAtError(("unit",), str(error)) from None

    @model_validator(mode="after")
    def _wraps(self) -> Self:
        if self.period is not None and (self.quantity != "position" or self.role != "observation"):
            raise ProblemAtError(("period",), "is of observed positions, and this is none; remove it")
        return self

    @property
    def wrap_period(self) -> float | None:
        """Period of the column in SI; None for one that does not wrap."""
        return None if self.period is None else abs(self.numbers.factor) * self.period

    @property
    def recorded(self) -> Channel:
        """The channel as the recording has it."""
        si = to_si(self.unit)
        values = self.model_dump(include=set(Channel.model_fields), exclude_defaults=True)
        noise = None if self.noise is None else self.noise * si.factor
        return Channel.model_validate(values | {"clock": self.clock, "unit": si.unit, "noise": noise})

    @property
    def numbers(self) -> ScaledColumn:
        """The column in SI."""
        factor = to_si(self.unit).factor
        return ScaledColumn.model_construct(
            column=self.column, factor=factor * self.sign * self.scale, offset=factor * self.offset
        )


class SignalMapping(Model):
    """How CSV files become a recording of signals."""

    format_version: Literal[2] = 2
    rig: Line = Field(description="name of the set-up")
    stand_in: StandIn = False
    note: FreeText = ""
    clocks: dict[Name, ClockFiles] = Field(
        min_length=1, max_length=100, description="name -> files of what was sampled together"
    )
    channels: dict[Name, ChannelColumn] = Field(
        min_length=1, max_length=500, description="name -> what a column means"
    )
    _document: Document = PrivateAttr()
    _name_patterns: dict[str, NamePattern] = PrivateAttr(default_factory=dict)

    @property
    def file(self) -> Path:
        """The mapping's own."""
        return self._document.path

    def where(self, *loc: str) -> str:
        """File, line and key of what it says, for errors."""
        return f"{self._document.where(loc)}: {'.'.join(loc)}"

    def name_pattern(self, clock: str) -> NamePattern | None:
        """What makes fields of the names of a clock's files."""
        return self._name_patterns.get(clock)

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        if len(self.clocks) == 1:
            for name, channel in self.channels.items():
                if "clock" not in channel.model_fields_set:
                    self.channels[name] = channel.model_copy(update={"clock": next(iter(self.clocks))})
        for name, channel in self.channels.items():
            if channel.clock not in self.clocks:
                raise ProblemAtError(
                    ("channels", name),
                    f"is on clock {channel.clock!r}, which is not among clocks ({', '.join(self.clocks)}); "
                    "name one of them as its clock",
                )
        for clock in self.clocks:
            if all(channel.clock != clock for channel in self.channels.values()):
                raise ProblemAtError(("clocks", clock), "has no channel; name it in one, or remove it")
        try:
            check_channels({name: channel.recorded for name, channel in self.channels.items()})
        except ProblemAtError as problem:
            raise ProblemAtError(("channels", *problem.loc), str(problem)) from None
        return self


@dataclass(frozen=True)
class ClockColumns:
    """What a mapping says of the files of one clock, as `read_rows` asks.

    Attributes:
        mapping: the whole of it.
        clock: which clock.
    """

    mapping: SignalMapping
    clock: str

    @property
    def rules(self) -> ClockFiles:
        """What it says of this clock."""
        return self.mapping.clocks[self.clock]

    @property
    def csv(self) -> CsvStyle:
        """What the files look like."""
        return self.rules.csv

    @property
    def file(self) -> Path:
        """The mapping's own."""
        return self.mapping.file

    @property
    def names(self) -> list[str]:
        """Channels of this clock."""
        return [name for name, channel in self.mapping.channels.items() if channel.clock == self.clock]

    @property
    def numbers(self) -> Mapping[str, ScaledColumn]:
        """Role (t and the channels) -> column."""
        time = self.rules.time
        found = {name: self.mapping.channels[name].numbers for name in self.names}
        if time.column is None:
            return found
        return {
            "t": ScaledColumn.model_construct(column=time.column, factor=to_si(time.unit).factor, offset=0.0),
            **found,
        }

    @property
    def texts(self) -> Mapping[str, str | int]:
        """The column that identifies episodes, if any."""
        return {} if self.rules.episode is None else {EPISODE: self.rules.episode}

    @property
    def sizes(self) -> tuple[float, float]:
        """Sizes of numbers; a computed control may be as small as it likes."""
        return 0.0, _LARGEST

    def location_of(self, role: str) -> str:
        """Where the mapping names a role's column."""
        loc = ("clocks", self.clock, "time") if role == "t" else ("channels", role)
        return self.mapping.where(*loc, "column")


def is_signal_mapping(file: Path) -> bool:
    """Whether a mapping is one of signals, and not of tracks.

    Raises:
        InputError: It is missing, or not YAML.
    """
    return bool(SIGNAL_KEYS & set(read_document(file).values))


def load_signal_mapping(file: Path) -> SignalMapping:
    """Read and check a mapping.

    Raises:
        InputError: It is missing, not YAML, or says something that cannot be.
    """
    document = read_document(file)
    mapping = validated(SignalMapping, document.values, document.where)
    mapping._document = document
    for clock, rules in mapping.clocks.items():
        pattern = rules.files.name_pattern
        if pattern is not None:
            where = mapping.where("clocks", clock, "files", "name_pattern")
            mapping._name_patterns[clock] = NamePattern(pattern, where)
        _check_style(mapping, clock)
    return mapping


def _check_style(mapping: SignalMapping, clock: str) -> None:
    """Checks of a clock that involve several keys."""
    columns = ClockColumns(mapping, clock)
    style = columns.csv
    if style.separator == style.decimal:
        raise InputError(
            f"{mapping.where('clocks', clock, 'csv', 'decimal')}: is the delimiter {style.decimal!r}, too; "
            "correct one of them"
        )
    if style.header:
        return
    for role, column in columns.numbers.items():
        if isinstance(column.column, str):
            raise InputError(
                f"{columns.location_of(role)}: {column.column!r} is a name, but csv.header is false; write "
                "the "
                "number of the column (the first is 0), or header: true"
            )
