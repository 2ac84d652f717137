"""What is odd in a recording of signals though it is valid: `odd_signals`."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from slapshot.recordings.channel_pair_quality import odd_pairs
from slapshot.recordings.data_quality import odd_order
from slapshot.recordings.position_quality import odd_positions
from slapshot.recordings.quality_warning import QualityWarning, WarningKind
from slapshot.recordings.sample_quality import odd_samples
from slapshot.recordings.signal_measures import Measured, Sampling, measure_all, sampling
from slapshot.recordings.signals import SignalRecording
from slapshot.text import printable

_MANY_MISSING, _LONG_GAP_S, _LONG_GAP = 0.05, 0.1, 5.5  # share of samples; s and intervals
_UNEVEN = 0.2  # intervals
_NAMED = 6  # channels of which a finding is told one by one
_REGULAR = 0.5  # intervals; controls that are written when they change are less so


def odd_signals(recording: SignalRecording, channels: Mapping[str, Measured]) -> list[QualityWarning]:
    """Everything odd in a recording, as far as it can be seen without a model; empty if nothing is.

    Args:
        recording: that has passed its checks.
        channels: name -> measure of the channel, of all of them.
    """
    found = [*odd_order(recording.episodes, "episode"), *same_episodes(recording)]
    for clock in recording.signals:
        found += odd_clock(recording, clock)
    found += controls_end(recording)
    for measured in channels.values():
        found += more_gaps(recording, measured)
        found += [*odd_samples(measured), *odd_positions(measured)]
    found += odd_pairs(list(channels.values()))
    return _merged(found)


def warnings_of(recording: SignalRecording) -> list[str]:
    """Everything odd in a recording, as `slapshot check` says it: one line a finding."""
    return [printable(str(finding)) for finding in odd_signals(recording, measure_all(recording))]


def _merged(findings: Iterable[QualityWarning]) -> list[QualityWarning]:
    """One finding a kind and reason, with what was said of each channel."""
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


def same_episodes(recording: SignalRecording) -> Iterator[QualityWarning]:
    """Episodes whose samples are the same to the last digit."""
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
            "one recording was copied: it counts twice, and held-out episodes are no longer held out",
            "episode",
        )


def odd_clock(recording: SignalRecording, clock: str) -> Iterator[QualityWarning]:
    """Rows that are missing, or follow each other unevenly."""
    channels = [channel for channel in recording.channels.values() if channel.clock == clock]
    found = clock_sampling(recording, clock)
    if all(channel.role == "control" for channel in channels):
        return  # controls hold between samples
    if _has_gaps(found):
        yield QualityWarning("gaps", f"clock {clock} has gaps: {_said(found)}", (), _GAP_MEANS, "episode")
    if found.jitter > _UNEVEN:
        yield QualityWarning(
            "uneven_clock",
            f"intervals of clock {clock} scatter by {found.jitter:.0%} (standard deviation)",
            (),
            "if times are those of writing, not of measuring, they err by as much: fast motion looks noisy",
            "episode",
        )


def more_gaps(recording: SignalRecording, measured: Measured) -> Iterator[QualityWarning]:
    """A channel that lacks samples which its clock has."""
    table = recording.signals[measured.channel.clock]
    if len(measured.samples) < len(table) and _has_gaps(measured.sampling):
        yield QualityWarning(
            "gaps", f"{measured.name} has gaps: {_said(measured.sampling)}", (), _GAP_MEANS, "episode"
        )


_GAP_MEANS = "what happens in a gap is not seen: split the episode there, or simulation must bridge it"


def _has_gaps(found: Sampling) -> bool:
    longest = max(_LONG_GAP_S, _LONG_GAP * found.interval_s)
    return found.missing > _MANY_MISSING or found.longest_gap_s > longest


def _said(found: Sampling) -> str:
    return f"{found.missing:.1%} of samples are missing, up to {found.longest_gap_s:.2g} s on end"


def controls_end(recording: SignalRecording) -> Iterator[QualityWarning]:
    """Controls that are given at a rate and end before the observations do."""
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
                "their last value is taken to hold: crop the observations if it did not",
                "episode",
            )
