"""Parameters that outlast the vehicle, in a file that ground stations read, too."""

from pathlib import Path

import pytest
from pymavlink import mavparm

from tests.vehicle_sim.foreign_pilot import AIRFRAME, EMPTY
from vehicle_sim.parameter_files import ParameterFileError, keep
from vehicle_sim.services.identity import FIRST, Identity
from vehicle_sim.services.parameter_store import Parameters
from vehicle_sim.services.parameter_table import TABLE
from vehicle_sim.vehicle import Vehicle


def parameters(identity: Identity = FIRST) -> Parameters:
    return Vehicle(AIRFRAME, EMPTY, identity=identity).parameters


def test_a_change_outlasts_the_vehicle(tmp_path: Path) -> None:
    file = tmp_path / "own.params"
    first = parameters()
    keep(first, file, ["NAV_DLL_ACT=3"])
    first.set("MPC_XY_CRUISE", 0.1 + 3.2)
    second = parameters(Identity(system=7))
    keep(second, file, [])
    assert (second["NAV_DLL_ACT"], second["MPC_XY_CRUISE"], second["MAV_SYS_ID"]) == (3, 0.1 + 3.2, 7)
    assert {name: first[name] for name in TABLE if name != "MAV_SYS_ID"} == {
        name: second[name] for name in TABLE if name != "MAV_SYS_ID"
    }
    assert [each.name for each in tmp_path.iterdir()] == ["own.params"]


def test_a_file_outlasts_starts_at_any_pace(tmp_path: Path) -> None:
    """Times after which a peer counts as lost stay the same in real time, however often it starts."""
    file, losses = tmp_path / "own.params", ("COM_DL_LOSS_T", "COM_OBC_LOSS_T", "COM_OF_LOSS_T", "COM_RC_LOSS_T")
    for pace in (1.0, 5.0, 5.0, 0.1, 1.0):
        flown = parameters()
        keep(flown, file, [], pace)
        assert flown["COM_OF_LOSS_T"] == pytest.approx(pace) and flown["COM_RC_LOSS_T"] == pytest.approx(0.5 * pace)
        again = parameters()
        keep(again, file, [])
        assert [again[name] for name in losses] == [TABLE[name].default for name in losses], pace


def test_a_change_at_another_pace_is_kept_as_it_is_at_real_time(tmp_path: Path) -> None:
    file = tmp_path / "own.params"
    flown = parameters()
    keep(flown, file, ["COM_DL_LOSS_T=40"], 4.0)
    assert flown.set("COM_OF_LOSS_T", 12.0) is None
    again, slow = parameters(), parameters()
    keep(again, file, [], 4.0)
    assert (again["COM_DL_LOSS_T"], again["COM_OF_LOSS_T"], again["COM_RC_LOSS_T"]) == (40, 12.0, 2.0)
    keep(slow, file, [])
    assert (slow["COM_DL_LOSS_T"], slow["COM_OF_LOSS_T"], slow["COM_RC_LOSS_T"]) == (10, 3.0, 0.5)


def test_mavproxys_form_is_read_too(tmp_path: Path) -> None:
    told = mavparm.MAVParmDict()
    told["COM_DISARM_LAND"], told["NAV_RCL_ACT"] = 4.5, 3.0
    file = tmp_path / "mav.parm"
    told.save(str(file))
    read = parameters()
    keep(read, file, [])
    assert (read["COM_DISARM_LAND"], read["NAV_RCL_ACT"]) == (4.5, 3)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("1\t1\tNOT_THERE\t1\t6", ["line 2", "NOT_THERE", "does not exist"]),
        ("1\t1\tNAV_DLL_ACT\t9\t6", ["line 2", "NAV_DLL_ACT", "out of range"]),
        ("1\t1\tNAV_DLL_ACT\t0.5\t6", ["line 2", "type mismatch"]),
        ("NAV_DLL_ACT three", ["line 2", "three"]),
        ("NAV_DLL_ACT 3 6", ["line 2"]),
    ],
)
def test_a_wrong_line_is_named(tmp_path: Path, line: str, words: list[str]) -> None:
    file = tmp_path / "own.params"
    file.write_text(f"# a comment\n{line}\n")
    with pytest.raises(ParameterFileError) as caught:
        keep(parameters(), file, [])
    assert all(word in str(caught.value) for word in words)


@pytest.mark.parametrize("assignment", ["NAV_DLL_ACT", "NAV_DLL_ACT=7", "MAV_SYS_ID=9", "NOPE=1"])
def test_a_wrong_assignment_is_named(assignment: str) -> None:
    with pytest.raises(ParameterFileError, match=f"--param {assignment}"):
        keep(parameters(), None, [assignment])


def test_a_disk_that_is_gone_is_said_at_the_start_and_ends_no_flight(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    with pytest.raises(ParameterFileError):
        keep(parameters(), folder / "own.params", [])
    folder.mkdir()
    kept = parameters()
    keep(kept, folder / "own.params", [])
    (folder / "own.params").unlink()
    folder.rmdir()
    assert kept.set("NAV_DLL_ACT", 3) is None


@pytest.mark.parametrize("name", ["a" * 300, "."])
def test_a_file_that_can_not_be_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(ParameterFileError, match=name):
        keep(parameters(), tmp_path / name, [])


def test_a_file_of_windows_is_read(tmp_path: Path) -> None:
    """With a mark of the byte order, and its ends of lines."""
    file = tmp_path / "own.params"
    file.write_bytes("\ufeff# Vehicle-Id Component-Id Name Value Type\r\n1\t1\tNAV_DLL_ACT\t3\t6\r\n".encode())
    read = parameters()
    keep(read, file, [])
    assert read["NAV_DLL_ACT"] == 3
