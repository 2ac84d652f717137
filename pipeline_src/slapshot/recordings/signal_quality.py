"""Quality warnings for a valid recording of signals: `signal_warnings`."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from slapshot.recordings.channel_pair_quality import channel_pair_warnings
from slapshot.recordings.data_quality import order_warnings
from slapshot.recordings.position_quality import position_warnings
from slapshot.recordings.quality_warning import QualityWarning, WarningKind
from slapshot.recordings.sample_quality import sample_warnings
from slapshot.recordings.signal_statistics import (
    ChannelStatistics,
    Sampling,
    all_channel_statistics,
    sampling,
)
from slapshot.recordings.signals import SignalRecording
from slapshot.text import printable

_MAX_MISSING, _LONG_GAP_S, _LONG_GAP = 0.05, 0.1, 5.5  # share of samples; s and intervals
_UNEVEN = 0.2  # intervals
_NAMED = 6  # channels that a warning lists individually
_REGULAR = 0.5  # intervals; controls that are written when they change are less so


def signal_warnings(
    recording: SignalRecording, channels: Mapping[str, ChannelStatistics]
) -> list[QualityWarning]:
    """All quality warnings that need no model; empty if there are none.

    Args:
        recording: that has passed its checks.
        channels: name -> statistics, for every channel.
    """
    found = [*order_warnings(recording.episodes, "episode"), *duplicate_episode_warnings(recording)]
    for clock in recording.signals:
        found += clock_warnings(recording, clock)
    found += control_end_warnings(recording)
    for measured in channels.values():
        found += channel_gap_warnings(recording, measured)
        found += [*sample_warnings(measured), *position_warnings(measured)]
    found += channel_pair_warnings(list(channels.values()))
    return _merged(found)


def quality_warning_lines(recording: SignalRecording) -> list[str]:
    """All quality warnings as printed by `slapshot check`, one line each."""
    return [
        printable(str(finding)) for finding in signal_warnings(recording, all_channel_statistics(recording))
    ]


def _merged(findings: Iterable[QualityWarning]) -> list[QualityWarning]:
    """Merge warnings of the same kind and reason into one that lists the channels."""
    alike: dict[tuple[WarningKind, str], list[QualityWarning]] = {}
    for finding in findings:
        alike.setdefault((finding.kind, finding.why), []).append(finding)
    merged = []
    for (kind, why), several in alike.items():
        what = "; ".join(finding.what for finding in several[:_NAMED])
        what += f"; and {len(several) - _NAMED} more" if len(several) > _NAMED else ""
        hits = sorted({hit for finding in several for hit in finding.hits})
        merged.append(QualityWarning(kind, what, tuple(hits), why, "episode"))
    return merged


def clock_sampling(recording: SignalRecording, clock: str) -> Sampling:
    """How regularly the rows of a clock follow each other."""
    return sampling([rows["t"].to_numpy() for _, rows in recording.signals[clock].groupby("episode")])


def duplicate_episode_warnings(recording: SignalRecording) -> Iterator[QualityWarning]:
    """Episodes with identical samples."""
    first: dict[bytes, int] = {}
    same = []
    parts = [dict(iter(table.groupby("episode"))) for table in recording.signals.values()]
    for episode in recording.episodes["episode"].tolist():
        key = b"".join(part[episode].drop(columns="episode").to_numpy().tobytes() for part in parts)
        if first.setdefault(key, episode) != episode:
            same += [first[key], episode]
    if same:
        yield QualityWarning(
            "same_episodes",
            f"{len(set(same))} of {len(recording.episodes)} episodes have the same samples as another",
            tuple(sorted(set(same))),
            "an episode was duplicated: it counts twice, and held-out episodes are no longer independent",
            "episode",
        )


def clock_warnings(recording: SignalRecording, clock: str) -> Iterator[QualityWarning]:
    """Missing rows and uneven sampling of a clock."""
    channels = [channel for channel in recording.channels.values() if channel.clock == clock]
    if not channels:
        return
    found = clock_sampling(recording, clock)
    if all(channel.role == "control" for channel in channels):
        # Where they are sampled regularly, it is no command that is held which is missing.
        if found.jitter < _REGULAR and found.longest_gap_s > max(_LONG_GAP_S, _LONG_GAP * found.interval_s):
            yield QualityWarning(
                "gaps",
                f"controls of clock {clock} have gaps: {_gap_text(found)}",
                (),
                "the value before a gap is held through it, and what was really commanded looks like a force "
                "from outside: split the episode there",
                "episode",
            )
        return
    if _has_gaps(found):
        yield QualityWarning("gaps", f"clock {clock} has gaps: {_gap_text(found)}", (), _GAP_MEANS, "episode")
    if found.jitter > _UNEVEN:
        yield QualityWarning(
            "uneven_clock",
            f"intervals of clock {clock} scatter by {found.jitter:.0%} (standard deviation)",
            (),
            "if the stamps are write times rather than measurement times, their error makes fast motion "
            "noisy",
            "episode",
        )


def channel_gap_warnings(recording: SignalRecording, measured: ChannelStatistics) -> Iterator[QualityWarning]:
    """A channel with gaps that its clock does not have."""
    table = recording.signals[measured.channel.clock]
    if len(measured.samples) < len(table) and _has_gaps(measured.sampling):
        yield QualityWarning(
            "gaps", f"{measured.name} has gaps: {_gap_text(measured.sampling)}", (), _GAP_MEANS, "episode"
        )


_GAP_MEANS = "motion within a gap is not observed: split the episode there, or the simulation must bridge it"


def _has_gaps(found: Sampling) -> bool:
    longest = max(_LONG_GAP_S, _LONG_GAP * found.interval_s)
    return found.missing > _MAX_MISSING or found.longest_gap_s > longest


def _gap_text(found: Sampling) -> str:
    return f"{found.missing:.1%} of samples are missing, up to {found.longest_gap_s:.2g} s at a time"


def control_end_warnings(recording: SignalRecording) -> Iterator[QualityWarning]:
    """Regularly sampled controls that end before the observations."""
    roles = {
        clock: {channel.role for channel in recording.channels.values() if channel.clock == clock}
        for clock in recording.signals
    }
    last = {clock: table.groupby("episode")["t"].max() for clock, table in recording.signals.items()}
    seen = [last[clock] for clock in last if "observation" in roles[clock]]
    end = np.maximum.reduce([times.to_numpy() for times in seen])
    for clock in (clock for clock in last if "control" in roles[clock]):
        found = clock_sampling(recording, clock)
        if not found.jitter < _REGULAR:
            continue
        early = end - last[clock].to_numpy() > _LONG_GAP * found.interval_s
        if early.any():
            short = float((end - last[clock].to_numpy()).max())
            yield QualityWarning(
                "controls_end",
                f"controls of clock {clock} end up to {short:.2g} s before the observations",
                tuple(map(int, last[clock].index[early])),
                "their last value is held: crop the observations if that is wrong",
                "episode",
            )
