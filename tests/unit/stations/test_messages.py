"""What stations send each other, as bytes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.formation.orbit import Center
from gcs.model.errors import LinkError
from gcs.model.lifecycle import ShowPhase
from gcs.model.vehicle_columns import SENT
from gcs.stations.messages import (
    COUNT_MAX,
    BatchHead,
    Echo,
    FormationMessage,
    SlotsMessage,
    StateBatch,
    VelocitiesMessage,
    decode_batch,
    numbers_of,
    site_number,
)
from gcs.stations.reported_vehicles import ReportedVehicles, take

DECODE = (decode_batch, FormationMessage.decode, SlotsMessage.decode, VelocitiesMessage.decode)


HEAD = BatchHead(
    sequence=7,
    site=site_number({"north": ("d1", "d2")}),
    term=3,
    lead=1,
    show=ShowPhase.RUNNING,
    all_up=True,
    pace=0.75,
    return_s=12.5,
    echoes=(Echo(1, 12, 0.25), Echo(2, 5, 0.5)),
)


def batch(count: int, head: BatchHead = HEAD) -> StateBatch:
    rng = np.random.default_rng(count)
    mask = rng.random((6, count)) < 0.5
    desired_m_s = rng.uniform(-8.0, 8.0, (count, 3))
    desired_m_s[::3] = np.nan
    age_s = rng.uniform(0.0, 1.0, count)
    age_s[1::4] = np.inf
    return StateBatch(
        head=head,
        position_m=rng.uniform(-500.0, 500.0, (count, 3)),
        velocity_m_s=rng.uniform(-8.0, 8.0, (count, 3)),
        unfiltered_m_s=0.5 * desired_m_s,
        desired_m_s=desired_m_s,
        setpoint_m_s=1.5 * desired_m_s,
        uncertainty_m=rng.uniform(0.02, 3.0, count),
        age_s=age_s,
        phases=rng.integers(0, 10, count).astype(np.uint8),
        modes=rng.integers(0, 9, count).astype(np.uint8),
        airborne=mask[0],
        formed=mask[1],
        slot_stays=mask[2],
        armed=mask[3],
        ready=mask[4],
        owned=mask[5],
        epochs=rng.integers(0, 256, count).astype(np.uint8),
        yaw_rad=rng.uniform(-3.1, 3.1, count),
        numbers=[np.where(mask[row % 2], 0.9, np.nan) for row in range(len(SENT))],
    )


@pytest.mark.parametrize("count", [0, 1, 50])
def test_batch_arrives_as_it_was(count: int) -> None:
    flown = np.ones(count, np.bool_)
    sent = batch(count)._replace(owned=flown, epochs=np.ones(count, np.uint8))
    head, wire = decode_batch(sent.encode())
    assert head == HEAD
    received = ReportedVehicles.unknown(count)
    take(received, np.arange(count), wire, 1, 100.0)
    known = np.isfinite(sent.age_s)
    assert received.position_m[known] == pytest.approx(sent.position_m[known], abs=1e-4)
    assert np.isnan(received.position_m[~known]).all()
    for name in ("velocity_m_s", "unfiltered_m_s", "desired_m_s", "setpoint_m_s"):
        there, here = getattr(sent, name)[known], getattr(received, name)[known]
        assert here == pytest.approx(there, abs=0.0051, nan_ok=True)
    assert received.uncertainty_m == pytest.approx(sent.uncertainty_m, abs=0.0051)
    assert 100.0 - received.measured_s == pytest.approx(sent.age_s, abs=0.00051)
    assert received.yaw_rad == pytest.approx(sent.yaw_rad, abs=0.000051)
    for name, values in zip(SENT, sent.numbers, strict=True):
        assert numbers_of(received.numbers)[name] == pytest.approx(values, nan_ok=True)
    for name in ("phases", "modes", "airborne", "formed", "slot_stays", "armed", "ready", "epochs"):
        assert (getattr(received, name) == getattr(sent, name)).all()
    assert (received.owner == 1).all()


def test_batch_of_the_largest_station_fits_into_a_message() -> None:
    assert len(batch(COUNT_MAX).encode()) <= 60_000


def test_formation_and_slots_arrive_as_they_were() -> None:
    center = Center(np.array([1.0, 2.0, -30.0]), np.array([0.5, 0.0, 0.1]), np.array([0.0, 0.2, 0.0]))
    sent = FormationMessage(9, 2, 1, 4, ShowPhase.PAUSED, center, 15.0, 0.1, {"tower": 1.0})
    received = FormationMessage.decode(sent.encode())
    assert received.center is not None
    assert (received.center.position_m == center.position_m).all()
    assert (received.radius_m, received.sides, received.plan) == (15.0, {"tower": 1.0}, 4)
    place = np.array([[0.6, 0.0, 0.8], [np.nan] * 3, [0.0, -1.0, 0.0]])
    slots = SlotsMessage.decode(SlotsMessage(9, 2, 1, place).encode())
    assert slots.place == pytest.approx(place, abs=1e-4, nan_ok=True)


def test_velocities_arrive_as_they_were_and_none_is_infinite() -> None:
    sent_m_s = np.array([[1.25, -4.0, 0.001], [np.nan] * 3, [np.inf, 0.0, 0.0]])
    received = VelocitiesMessage.decode(VelocitiesMessage(9, 2, 1, sent_m_s).encode())
    assert (received.site, received.term, received.lead) == (9, 2, 1)
    assert received.velocity_m_s[0] == pytest.approx(sent_m_s[0], abs=1e-6)
    assert np.isnan(received.velocity_m_s[1:]).all()
    with pytest.raises(LinkError, match="for 3 vehicles"):
        VelocitiesMessage.decode(VelocitiesMessage(9, 2, 1, sent_m_s).encode()[:-1])


@given(st.binary(max_size=300))
def test_junk_is_refused(junk: bytes) -> None:
    for decode in DECODE:
        with pytest.raises(LinkError):
            decode(junk)


@given(st.data())
def test_damaged_messages_are_refused_or_stay_finite(data: st.DataObject) -> None:
    whole = bytearray(batch(3).encode())
    at = data.draw(st.integers(0, len(whole) - 1))
    whole[at] ^= 1 << data.draw(st.integers(0, 7))
    cut = data.draw(st.integers(0, len(whole)))
    with pytest.raises(LinkError):
        decode_batch(bytes(whole[:cut])[:-1])
    try:
        head, wire = decode_batch(bytes(whole))
    except LinkError:
        return
    assert 0.0 <= head.pace <= 1.0
    assert len(wire) == 3
    received = ReportedVehicles.unknown(3)
    take(received, np.arange(3), wire, 1, 100.0)
    assert not np.isinf(received.position_m).any()
