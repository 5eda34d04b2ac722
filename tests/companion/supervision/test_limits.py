"""The watch over the fence: said once, over only well inside, and a vehicle that does not come back lands."""

from companion.config_limits import Geofence
from companion.supervision.limits import FenceWatch

SECOND = 1_000_000_000
SETTINGS = Geofence(radius=25.0)
LAND_NS = round(SETTINGS.land_after * SECOND)


def test_leaving_and_coming_back_are_said_once_each() -> None:
    watch = FenceWatch(SETTINGS)
    places = [-1.0, 0.5, 0.6, -0.2, 0.1, -0.4, -0.5]
    news = [watch.judge(beyond, True, second * SECOND)[1] for second, beyond in enumerate(places)]
    assert news[1] == "beyond the fence by 0.5 m: coming back"
    assert news[5] == "within the fence again", "not before it is well inside"
    assert [text for second, text in enumerate(news) if second not in (1, 5)] == [""] * 5


def test_who_does_not_come_nearer_lands() -> None:
    watch = FenceWatch(SETTINGS)
    watch.judge(5.0, True, 0)
    assert watch.judge(5.0, True, LAND_NS)[0] is None
    assert watch.judge(3.9, True, LAND_NS + 1)[0] is None, "a metre nearer: the time begins anew"
    assert watch.judge(3.9, True, 2 * LAND_NS)[0] is None
    must = watch.judge(3.9, True, 2 * LAND_NS + 2)[0]
    assert must is not None and "3.9 m, and not coming back" in must


def test_who_is_flown_by_others_need_not_come_back() -> None:
    watch = FenceWatch(SETTINGS)
    watch.judge(5.0, False, 0)
    assert watch.judge(9.0, False, 3 * LAND_NS)[0] is None
    assert watch.judge(9.0, True, 4 * LAND_NS)[0] is None, "the time begins when control is given back"
    assert watch.judge(9.0, True, 4 * LAND_NS + 1)[0] is not None


def test_who_creeps_nearer_lands_all_the_same() -> None:
    watch = FenceWatch(SETTINGS)
    seconds = round(LAND_NS / SECOND) + 2
    judged = [watch.judge(5.0 - 0.9 * second / seconds, True, second * SECOND)[0] for second in range(seconds)]
    assert judged[0] is None and judged[-1] is not None
