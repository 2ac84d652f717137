"""The comparison with mujoco.sysid: the peer fits what it is asked to; the page says what was measured."""

import mujoco
import numpy as np
import pandas as pd
from slapshot.benchmark.joint_peers import LINKS, RIG, SCENARIOS, fit_by_sysid, write_comparison
from slapshot.calibration.calibration_rigs import calibration_rig, simulate_recording
from slapshot.diagnosis.model.recorded_trajectory import recorded_trajectory
from slapshot.diagnosis.model.rig import bind
from slapshot.diagnosis.model.rig_motion import rig_motion
from slapshot.diagnosis.model.segments import segment_recording
from slapshot.effects.joints.catalogue import instances
from slapshot.lab.joints.rigs import nominal_model


def test_the_peer_finds_a_mass_that_is_off():
    simulated = calibration_rig(RIG)
    rng = np.random.default_rng(1)
    motion = simulated.draw(3, 1.0, rng)
    plain = simulate_recording(simulated, motion, None, np.zeros(0))
    nominal = bind(mujoco.MjSpec.from_string(nominal_model(RIG)), simulated.channels)
    segments = segment_recording(plain, nominal)
    known = instances(rig_motion(nominal, segments, recorded_trajectory(nominal, segments)))
    mass = next(e for e in known if e.key == "link_mass@fore")
    noise = 1e-3 * rng.standard_normal((3, 200, 3))
    recording = simulate_recording(simulated, motion, mass, np.array([0.3]), noise)
    found, widths = fit_by_sysid(recording, nominal, segment_recording(recording, nominal), motion.start)
    # Its own half-widths of 90 %, of which three are five standard deviations.
    assert np.all((widths > 0) & (widths < 0.05))
    np.testing.assert_allclose(found - [0.0, 0.3], 0, atol=3 * widths.max())


def test_the_page_holds_medians_and_each_recording(tmp_path):
    rows = [
        {
            "scenario": scenario, "seed": seed, "truth": "link_mass@fore mass_factor 2", "floor_mrad": 2.0,
            "tool": tool, "seconds": 3.0 * seed, "error_mrad": 4.0, "says": "p = 0.5",
            **{f"{link}_{part}": 0.1 for link in LINKS for part in ("excess", "half_width")},
        }
        for scenario in SCENARIOS for tool in ("one", "other") for seed in (1, 2, 3)
    ]  # fmt: skip
    write_comparison(pd.DataFrame(rows), tmp_path)
    page = (tmp_path / "joint_peers.md").read_text()
    assert "| a mass is off | one | 6 (3 to 9) | 2 (2 to 2) |" in page
    assert page.count("upper +0.100 (0.100); fore +0.100 (0.100)") == len(rows)
    assert "stand-in" in page
    assert len(pd.read_csv(tmp_path / "joint_peers.csv")) == len(rows)
