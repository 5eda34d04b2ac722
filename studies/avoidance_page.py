"""docs/avoidance.md: how far each method of avoidance can be trusted."""

from studies.report import Page

AVOIDANCE = Page(
    name="avoidance",
    introduction="""# Avoidance, measured

The default method of avoidance, and in some places the paper's rule, in places that are made by seed:
`python -m studies worlds NAME --seed N --picture` makes one, with a mission that flies through it; hills and low walls
are made by their study alone. A flight is the whole companion and the whole simulated vehicle,
MAVLink between them, joined in memory; the same bytes as from two processes (`tests/studies/test_campaign.py`). It is a
success if the vehicle came within 2 m of the goal, in time, and touched nothing until it stood there.

`python -m studies avoidance --seeds 100` flies the whole table, each set-up with as many seeds as its floor is meant
for (20, 50 or 100), hours on a small machine; `python -m studies forest --seeds 5 --method astar` a part of it. Each
case that is flown is kept as Parquet, one row a flight, in `logs/avoidance/`; a page tells of all that is kept there,
and `--seeds 0` writes it without flying. A floor is compared with the share itself; Wilson's 95 % interval stands
beside it. Pictures of single flights are flown again each time.

The tables are not all of one version. What is told of which, and what later ones gave where they were flown:

- **Shafts, passages, alleys, halls, offices:** a recent version. The present one was flown in 20 of each: all arrive.
- **Bent, round and turned places:** the present version, all by one. Times a stage are of a machine that had other work
  beside.
- **The long forest:** a recent version. Times a stage are of a machine that had other work beside.
- **Movers:** the present version, all by one. Of the two walkers who are met in fifty streets one comes out from behind
  another one 0.9 m away, and one turns round 2.2 m away while the vehicle leans and does not see him. Of who is as wide
  as a car, and of three at once, those are met who come obliquely from ahead: they seem to cross more slowly at first
  than they do, and the vehicle steps aside to where they go. Times a stage are of a machine that had other work beside.
- **Walkers indoors** are in no table yet. At 3 m/s the present version meets none in 20 halls 2.4 to 4 m wide, touches
  something by at most 6 mm in 3 of 40 doors 1.4 to 2.2 m wide, and in 7 of 60 flights through aisles 2.5 to 3.5 m wide,
  each with a walker to and fro. Who comes round a corner is seen too late, the more so as the vehicle leans in a turn;
  in a dead end there may be no room to step aside. Slower flights are no safer: 5 of the first 33 at 1.5 m/s.
- **What is larger than the map's window** of 48 m is in no table yet: traps 26 to 36 m deep, and walls of 90 m with one
  gap 26 to 38 m aside. The present version arrives behind all of 8 and 8, at 4 or 8 m/s. The one before flew to and fro
  in the two of them that it was flown in.
- **Forests and fields:** the present version with the default method, an earlier one with the paper's rule. Above 6 m/s
  paths are made smooth and followed by their curve; 40 m without a tree are flown at 5.93 m/s where 7 are commanded,
  and at 7.05 where 10 are. Times a stage in the fields are of a machine that had other work beside.
- **Traps, narrow places:** an earlier version. The present one reaches the goal in all of 20 traps, of 20 mazes and of
  20 gaps of 0.9 m. An older one came through 16 of these: a scan that shows such a gap closed for a moment turned it
  round (`avoidance.plan.turn_scans`). Gaps of 0.84 m, with 6 cm on either side, are passed in three of six; before the
  others the vehicle gives up or goes on looking for a way. One in seven was touched before a slow vehicle braked
  straight.
- **Courts:** an earlier version. The present one has landed in all of the same twenty 31 to 46 s after its start, and
  keeps 0.7 m from all walls and their edges.
- **Yards of containers** are in no table yet: rows with gaps of 0.05 to 2.2 m. The present version arrives in all of
  ten, by 1.16 times the shortest ways. The one before gave one up, where it flew to and fro between a gap that it saw
  closed askew and another one, and flew 1.8 times the shortest ways.
- **Flights on sensors:** an earlier version. Of the present one's, 20 of each row, 257 of 260 arrive, through passages
  on 1.1 times the shortest way, not 2.5. The three others are gaps with a corrected receiver, of which 19 of 20 were
  passed before: two flights were out of time, one touched a wall by half a millimetre, at 0.2 m/s.
- **Hills and low walls:** the present version, all by one. With heights from the start on an earlier one arrived in 23
  of 50.

## What the sensor can't see

The scan is flat: it shows what crosses the plane of its beams. Keep the vehicle out of places with the rest.
`companion mission show` says what of it a mission makes likely.

| what | why | in flight | safe at |
| --- | --- | --- | --- |
| wire 15-20 cm above or below the plane | no beam meets it | 0 of 9 flights passed it | no speed |
| beam that hangs 5-40 cm above the plane | only a tilted scan may meet it | 4 of 4 flights hit it | no speed |
| what ends below the plane | no beam meets it | [releases](lidar.md#what-a-driver-sends) stop above it | that height |
| glass that lets the beams through | they return from behind it | it is flown into | no speed |
| glass or mirrors without a return | the sector stays unknown, not free | the hull stays out | any speed |
| who crosses before a fast, low flight | the scan meets the ground | at 8 m/s 4 of 24 hit | 5 m/s |
| what hangs from 1 m below the flight on | the leaning scan looks beneath it | at 8 m/s 3 of 4 hit | 5 m/s |
| pole thinner than the beams' spacing | one beam in 5 degrees may miss it | 5 cm at 4.3 m/s: some hit | see below |

At 2 m above the ground and 7 m/s the scan shows a person from 7 m on, by its angle; higher up from farther away. The
flights at 8 m/s were at 2 m, too, three walkers in each. What counts is how far the vehicle leans, by its drag and the
wind. So it is no faster than it can stop within what its scan, leaning as it must to keep its speed, sees before it
meets the ground (`guard.sight_s`). Without that rule 8 of the 24 at 8 m/s met somebody; and on streets at 6 m/s, with
2.9 times the drag of the paper's vehicle and a lean of 31 degrees, 5 of 20, where with it 2 did. In a street with ten
walkers it should not be faster than 4 m/s. There none of 20 flights met one at 4 m/s, and none of 20 at 6 m/s; before
an evasion ended with a stop (`guard.evasion_stops`), 4 of 30 and 2 of 12 did.
`companion mission show` names the legs on which that is too late.
So it does with what hangs in the way, as a billboard, and `companion demo` says it at its start. With
`avoidance.map.layer=1.0` what the scan shows more than 1 m below the flight does not count as free: the vehicle is
slower, and none of three flights hit the billboard.

With one beam in each sector of 5 degrees a pole is met by a beam, however the vehicle stands, from `width / 0.087` on.
The speed is that from which the guard's braking (5.5 m/s2 after 0.25 s) stops the hull (0.36 m) within that distance. A
LiDAR that reports the nearest of many beams in each sector, as most do, sees thin poles from farther away. The ends of
walls beside narrow doors need [two beams](lidar.md#what-a-driver-sends).

| width of the pole (cm) | seen for certain from (m) | stops from (m/s) |
| --- | --- | --- |
| 5 | 0.57 | 0.7 |
| 10 | 1.15 | 1.9 |
| 20 | 2.3 | 3.4 |
| 30 | 3.4 | 4.6 |
| 50 | 5.7 | 6.4 |
""",
    studies=(
        "studies.forest",
        "studies.fast",
        "studies.traps",
        "studies.narrow",
        "studies.enclosed",
        "studies.askew",
        "studies.rising",
        "studies.moving",
        "studies.barn",
        "studies.estimated",
    ),
)
