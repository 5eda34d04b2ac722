"""Data files: what is good is read, and what is not is one line that names the file and the key."""

import codecs
import tomllib
from pathlib import Path
from typing import Any

import msgspec
import pytest

from protocol import toml_files
from protocol.toml_files import TomlFileError
from protocol.vehicle_parameters import GRAVITY, VehicleParameters


class Wing(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    span_m: float
    count: int = 2


class Craft(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    body: VehicleParameters
    wing: Wing | None = None
    via: tuple[tuple[float, float], ...] = ()
    armed: bool = False


GOOD = """
name = "test craft"
[body]
mass_kg = 0.65
arm_length_m = 0.23
inertia_kgm2 = [7.5e-3, 7.5e-3, 1.3e-2]
rotor_max_thrust_n = 4
torque_per_thrust_m = 0.016
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "craft.toml"
    path.write_text(GOOD)
    return path


def refusal(path: Path, *overrides: str) -> str:
    """The one line with which it is refused."""
    with pytest.raises(TomlFileError) as refused:
        toml_files.load(path, Craft, overrides)
    text = str(refused.value)
    assert "\n" not in text
    return text


# --- reading ----------------------------------------------------------------------------------------------------------


def test_a_good_file(path: Path) -> None:
    craft = toml_files.load(path, Craft)
    assert craft.name == "test craft"
    assert craft.body == VehicleParameters(0.65, 0.23, (7.5e-3, 7.5e-3, 1.3e-2), 4.0, 0.016)


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('name = "test craft"', 'name = "test craft"\nnmae = "typo"', "nmae"),
        ("mass_kg = 0.65", "mass_kg = 0.65\nmas_kg = 1.0", "mas_kg"),
        ("mass_kg = 0.65", "", "mass_kg"),
        ('name = "test craft"', "", "name"),
        ("mass_kg = 0.65", "mass_kg = -0.65", "body.mass_kg"),
        ("mass_kg = 0.65", "mass_kg = 0", "body.mass_kg"),
        ("mass_kg = 0.65", "mass_kg = nan", "body.mass_kg"),
        ("mass_kg = 0.65", "mass_kg = inf", "body.mass_kg"),
        ("mass_kg = 0.65", "mass_kg = 1e999", "body.mass_kg"),
        ("mass_kg = 0.65", 'mass_kg = "heavy"', "body.mass_kg"),
        ("mass_kg = 0.65", "mass_kg = 0.65\nparcel_mass_kg = -0.1", "body.parcel_mass_kg"),
        ("1.3e-2]", "0.0]", "body.inertia_kgm2[2]"),
        ("1.3e-2]", "-inf]", "body.inertia_kgm2[2]"),
        (", 1.3e-2]", "]", "body.inertia_kgm2"),
        ("[body]", "[bdoy]", "bdoy"),
        ("[body]", "armed = 1\n[body]", "armed"),
        ("[body]", "via = [[0, 1], [2, true]]\n[body]", "via[1][1]"),
        ("[body]", "wing = 3\n[body]", "wing"),
    ],
)
def test_what_does_not_fit_is_refused_with_file_and_key(path: Path, old: str, new: str, key: str) -> None:
    assert old in GOOD
    path.write_text(GOOD.replace(old, new))
    text = refusal(path)
    assert text.startswith(f"{path}: ")
    assert f"`{key}`" in text


def test_a_byte_order_mark_is_read_over(path: Path) -> None:
    """Programs of Windows write it."""
    plain, craft = path.read_bytes(), toml_files.load(path, Craft)
    path.write_bytes(codecs.BOM_UTF8 + plain)
    assert toml_files.load(path, Craft) == craft and toml_files.content(path) == plain


@pytest.mark.parametrize(
    "content",
    [
        b"name = ",
        b"name = 'a'\nname = 'b'",
        b"[body\n",
        b"name = '\xff\xfe'",
        b"number = " + b"9" * 5000,
        b"list = " + b"[" * 5000,
        b"table" + b".a" * 5000 + b" = 1",
        b"\x00",
    ],
)
def test_what_is_no_toml_is_refused_with_the_file(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    text = refusal(path)
    assert text.startswith(f"{path}: ")
    assert len(text) > len(str(path)) + 5


def test_a_file_without_end_is_refused() -> None:
    with pytest.raises(TomlFileError, match=r"^/dev/zero: more than 64 MB$"):
        toml_files.read(Path("/dev/zero"))


def test_broken_toml_is_refused_with_the_line(path: Path) -> None:
    path.write_text(GOOD + "mass_kg 3\n")
    assert f"line {GOOD.count(chr(10)) + 1}," in refusal(path)


def test_a_file_that_cant_be_read(tmp_path: Path) -> None:
    assert refusal(tmp_path) == f"{tmp_path}: Is a directory"
    assert refusal(tmp_path / "none.toml") == f"{tmp_path / 'none.toml'}: No such file or directory"


# --- overrides --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("override", "changed"),
    [
        ("body.mass_kg=1.5", lambda craft: craft.body.mass_kg == 1.5),
        ("body.mass_kg = 2", lambda craft: craft.body.mass_kg == 2.0),
        (" armed=true", lambda craft: craft.armed is True),
        ("name=hawk", lambda craft: craft.name == "hawk"),
        ("name = hawk of the north ", lambda craft: craft.name == "hawk of the north"),
        ('name="42"', lambda craft: craft.name == "42"),
        ("name=a=b", lambda craft: craft.name == "a=b"),
        ("name=", lambda craft: craft.name == ""),
        ("via=[[1, 2], [3.5, -4]]", lambda craft: craft.via == ((1.0, 2.0), (3.5, -4.0))),
        ("wing.span_m=3", lambda craft: craft.wing == Wing(3.0)),
        ("wing={span_m = 4, count = 1}", lambda craft: craft.wing == Wing(4.0, 1)),
    ],
)
def test_overrides(path: Path, override: str, changed: Any) -> None:
    assert not changed(toml_files.load(path, Craft))
    assert changed(toml_files.load(path, Craft, [override]))


def test_of_two_overrides_the_last_counts(path: Path) -> None:
    craft = toml_files.load(path, Craft, ["wing.span_m=3", "wing.count=4", "wing.span_m=5"])
    assert craft.wing == Wing(5.0, 4)


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("body.mass_kg=heavy", "body.mass_kg"),
        ("body.mass_kg=-1", "body.mass_kg"),
        ("body.mass_kg=nan", "body.mass_kg"),
        ("body.mass_kg=", "body.mass_kg"),
        ("body.mass_kg=" + "9" * 5000, "body.mass_kg"),
        ("name=42", "name"),
        ("armed=yes", "armed"),
        ("wing.count=2.5", "wing.count"),
        ("wing.count=2", "span_m"),
        ("body.colour=red", "colour"),
        ("colour=red", "colour"),
        ("wings.count=2", "wings"),
        ("body=3", "body"),
    ],
)
def test_impossible_overrides_are_refused_with_file_and_key(path: Path, override: str, key: str) -> None:
    text = refusal(path, "armed=true", override)
    assert text.startswith(f"{path} with --set: ")
    assert f"`{key}`" in text


@pytest.mark.parametrize("override", ["", "mass", "=3", "body.=3", ".mass_kg=3", "body..mass_kg=3", " =3"])
def test_overrides_that_are_none_are_refused_as_written(path: Path, override: str) -> None:
    assert refusal(path, override).startswith(f"--set {override}: ")


@pytest.mark.parametrize("override", ["name.first=hawk", "body.mass_kg.value=3", "body.inertia_kgm2.0=1.0"])
def test_an_override_inside_of_a_value(path: Path, override: str) -> None:
    text = refusal(path, override)
    assert text.startswith(f"--set {override}: ")
    assert "not a table" in text


@pytest.mark.parametrize("more", ["wing.count=3", "[wing]\ncount=3", "[wing]", "body.mass_kg=2"])
def test_an_override_of_several_keys_is_refused(path: Path, more: str) -> None:
    """The shell has passed on the end of a line."""
    text = refusal(path, f"wing.span_m=2\n{more}")
    assert text.startswith("--set 'wing.span_m=2\\n") and "several keys" in text


def test_an_array_of_several_lines_is_one_value(path: Path) -> None:
    assert toml_files.load(path, Craft, ["via=[\n[1, 2],\n[3, 4],\n]\n"]).via == ((1.0, 2.0), (3.0, 4.0))


def test_tables_that_were_handed_over_stay_as_they_were() -> None:
    tables: dict[str, Any] = {"span_m": 1.0}
    assert toml_files.convert(tables, Wing, "a test", ["span_m=2", "count=3"]) == Wing(2.0, 3)
    assert tables == {"span_m": 1.0}
    with pytest.raises(TomlFileError, match=r"^a test: .*`count`"):
        toml_files.convert({"span_m": 1.0, "count": "two"}, Wing, "a test")


# --- finding ----------------------------------------------------------------------------------------------------------


def test_files_are_found_by_path_here_and_in_the_project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    project = toml_files.ROOT / "vehicles" / "paper_quad.toml"
    assert toml_files.find("vehicles", "paper_quad") == project
    assert toml_files.find("vehicles", str(project)) == project
    own = tmp_path / "vehicles" / "paper_quad.toml"
    own.parent.mkdir()
    own.touch()
    assert toml_files.find("vehicles", "paper_quad").resolve() == own.resolve()  # one's own goes first
    assert toml_files.find("worlds", "vehicles/paper_quad.toml").resolve() == own.resolve()


def test_a_missing_file_is_answered_with_the_names_that_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "vehicles").mkdir()
    (tmp_path / "vehicles" / "of_my_own.toml").touch()
    with pytest.raises(TomlFileError, match=r"^papre_quad: .*vehicles/.*of_my_own.*paper_quad"):
        toml_files.find("vehicles", "papre_quad")
    with pytest.raises(TomlFileError, match=r"^any: .*balloons/ \(there: nothing\)"):
        toml_files.find("balloons", "any")


@pytest.mark.parametrize("name", ["", ".", "vehicles", "x" * 5000, "no\0name", "paper_quad/"])
def test_strange_names_are_refused(name: str) -> None:
    with pytest.raises(TomlFileError):
        toml_files.find("vehicles", name)


# --- the body ---------------------------------------------------------------------------------------------------------


def test_every_vehicle_of_the_project_has_a_body_that_can_fly() -> None:
    class VehicleFile(msgspec.Struct):
        body: VehicleParameters

    files = sorted((toml_files.ROOT / "vehicles").glob("*.toml"))
    assert files
    for file in files:
        body = toml_files.load(file, VehicleFile).body
        assert (body.mass_kg + body.parcel_mass_kg) * GRAVITY < 0.9 * body.max_thrust_n
        x, y, z = body.inertia_kgm2
        assert max(x, y, z) <= 0.5 * (x + y + z), "no body has such moments of inertia"


def test_thrust_and_torque_at_full_throttle() -> None:
    body = VehicleParameters(0.65, 0.23, (7.5e-3, 7.5e-3, 1.3e-2), 4.0, 0.016)
    assert body.max_thrust_n == 16.0
    assert body.hover_thrust * 16.0 == pytest.approx(0.65 * GRAVITY)
    thrusts = {"front": (0.23, 0.0, 1), "right": (0.0, 0.23, -1), "back": (-0.23, 0.0, 1), "left": (0.0, -0.23, -1)}

    def torque(full: set[str]) -> tuple[float, float, float]:
        """r x F of rotors pulling up (FRD: 0, 0, -4 N), and the drag of those that spin one way or the other."""
        arms = [thrusts[name] for name in full]
        roll, pitch = sum(-4.0 * y for _, y, _ in arms), sum(4.0 * x for x, _, _ in arms)
        return roll, pitch, sum(0.016 * 4.0 * spin for _, _, spin in arms)

    roll, pitch, yaw = body.full_torque_nm
    assert torque({"left"})[0] == pytest.approx(roll)
    assert torque({"front"})[1] == pytest.approx(pitch)
    assert torque({"front", "back"})[2] == pytest.approx(yaw)


# --- old names --------------------------------------------------------------------------------------------------------

RENAMED = {"frame": "body", "frame.weight": "body.mass_kg", "wing.number": "wing.count"}


@pytest.mark.parametrize(
    ("key", "new"),
    [
        ("frame.weight", "body.mass_kg"),
        ("frame.arm_length_m", "body.arm_length_m"),
        ("frame", "body"),
        ("frames.weight", "frames.weight"),
        ("wing.span_m", "wing.span_m"),
    ],
)
def test_the_longest_old_name_that_fits_counts(key: str, new: str) -> None:
    assert toml_files.new_name(key, RENAMED) == new
    assert toml_files.override_with_new_name(f" {key} = [1, 2]", RENAMED) == f"{new}= [1, 2]"


def test_tables_with_old_names_are_read_only_where_that_is_asked_for(path: Path) -> None:
    new = tomllib.loads(GOOD)
    old = {"name": new["name"], "frame": dict(new["body"]), "wing": {"span_m": 1.0, "number": 3}}
    old["frame"]["weight"] = old["frame"].pop("mass_kg")
    craft = toml_files.convert(toml_files.with_new_names(old, RENAMED), Craft, "log", renamed=RENAMED)
    assert craft.body == toml_files.load(path, Craft, renamed=RENAMED).body and craft.wing == Wing(1.0, 3)
    with pytest.raises(
        TomlFileError, match=r"^log: .*frame\.weight is now body\.mass_kg.*wing\.number is now wing\.count"
    ):
        toml_files.convert(old, Craft, "log", renamed=RENAMED)
    assert toml_files.with_new_names({"via": [], "wing": {}}, RENAMED) == {"via": [], "wing": {}}


# --- slips ------------------------------------------------------------------------------------------------------------


class Leg(msgspec.Struct, forbid_unknown_fields=True):
    north: float = 0.0


class Trip(msgspec.Struct, forbid_unknown_fields=True):
    speed: float = 1.0
    wing: Wing | None = None
    legs: list[Leg] = []


@pytest.mark.parametrize(
    ("override", "meant"),
    [
        ("sped=2", "; did you mean speed?"),
        ("wing.spam_m=2", "; did you mean wing.span_m?"),
        ("span_m=2", "; did you mean wing.span_m?"),
        ("legs=[{nort = 2}]", "; did you mean legs.north?"),
        ("wings.span_m=2", "; did you mean wing?"),
        ("colour=2", "`colour`"),
        ("speed='fast'", "got `str` - at `speed`"),
    ],
)
def test_what_was_meant_is_said(override: str, meant: str) -> None:
    with pytest.raises(TomlFileError) as caught:
        toml_files.convert({}, Trip, "trip", [override])
    assert str(caught.value).endswith(meant)


def test_a_name_that_is_nearly_one_is_said() -> None:
    with pytest.raises(TomlFileError, match=r"did you mean hover\?$"):
        toml_files.find("missions", "hovr")
    with pytest.raises(TomlFileError, match=r"\)$"):
        toml_files.find("missions", "xyz")
