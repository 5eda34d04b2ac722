"""The parameters of the vehicle: those of PX4 1.16 in SITL that mean something to it, and those that ground stations
ask for. `parameter_store.py` says which of them something obeys; the others are kept and do nothing.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Entry:
    """A parameter. The default is int for an integer parameter; a limit is None where there is none."""

    default: float | int
    least: float | None
    most: float | None

    @property
    def is_integer(self) -> bool:
        return isinstance(self.default, int)


_TABLE = """
# name           type    default    least      most
BAT1_CAPACITY    float      -1.0     -1.0  100000.0
BAT1_N_CELLS     int           4        0        16
BAT1_R_INTERNAL  float      -1.0     -1.0       0.2
BAT1_SOURCE      int           0       -1         2
BAT1_V_CHARGED   float      4.05        -         -
BAT1_V_EMPTY     float       3.6        -         -
BAT_AVRG_CURRENT float      15.0      0.0     500.0
BAT_CRIT_THR     float      0.07     0.05       0.5
BAT_EMERGEN_THR  float      0.05     0.03       0.5
BAT_LOW_THR      float      0.15     0.12       0.5
CAL_ACC0_ID      int     1310988        -         -
CAL_GYRO0_ID     int     1310988        -         -
CAL_MAG0_ID      int      197388        -         -
CAL_MAG0_ROT     int          -1       -1       100
CAL_MAG1_ID      int      197644        -         -
CAL_MAG1_ROT     int          -1       -1       100
CAL_MAG2_ID      int           0        -         -
CAL_MAG2_ROT     int          -1       -1       100
CAL_MAG3_ID      int           0        -         -
CAL_MAG3_ROT     int          -1       -1       100
CA_AIRFRAME      int           0        0        15
CA_ROTOR_COUNT   int           4        0        12
CBRK_FLIGHTTERM  int      121212        0    121212
CBRK_IO_SAFETY   int       22027        0     22027
CBRK_SUPPLY_CHK  int           0        0    894281
CBRK_USB_CHK     int      197848        0    197848
COM_ARM_MIS_REQ  int           0        0         1
COM_ARM_WO_GPS   int           1        0         2
COM_DISARM_LAND  float       2.0        -         -
COM_DISARM_MAN   int           1        0         1
COM_DISARM_PRFLT float      10.0        -         -
COM_DLL_EXCEPT   int           0        0         7
COM_DL_LOSS_T    int          10        5       300
COM_FAIL_ACT_T   float       5.0      0.0      25.0
COM_FLIGHT_UUID  int           0        0         -
COM_FLTMODE1     int          -1       -1       107
COM_FLTMODE2     int          -1       -1       107
COM_FLTMODE3     int          -1       -1       107
COM_FLTMODE4     int          -1       -1       107
COM_FLTMODE5     int          -1       -1       107
COM_FLTMODE6     int          -1       -1       107
COM_FLT_TIME_MAX int          -1       -1         -
COM_HOME_EN      int           1        0         1
COM_HOME_IN_AIR  int           0        0         1
COM_LOW_BAT_ACT  int           3        0         3
COM_OBC_LOSS_T   float       5.0      0.0      60.0
COM_OBL_RC_ACT   int           0        0         7
COM_OF_LOSS_T    float       1.0      0.0      60.0
COM_POSCTL_NAVL  int           0        0         1
COM_PREARM_MODE  int           0        0         2
COM_RCL_EXCEPT   int           0        0         7
COM_RC_IN_MODE   int           1        0         4
COM_RC_LOSS_T    float       0.5      0.0      35.0
COM_RC_OVERRIDE  int           1        0         3
COM_RC_STICK_OV  float      30.0      5.0      80.0
COM_SPOOLUP_TIME float       1.0      0.0      30.0
COM_TAKEOFF_ACT  int           0        0         1
CP_DIST          float      -1.0     -1.0      15.0
EKF2_EN          int           1        0         1
EKF2_GPS_CTRL    int           7        0        15
EKF2_HGT_REF     int           1        0         3
EKF2_MAG_TYPE    int           0        0         6
FD_ACT_EN        int           1        0         1
FD_FAIL_P        int          60        0       180
FD_FAIL_R        int          60        0       180
GF_ACTION        int           2        0         5
GF_MAX_HOR_DIST  float       0.0      0.0   10000.0
GF_MAX_VER_DIST  float       0.0      0.0   10000.0
GF_PREDICT       int           0        0         1
GF_SOURCE        int           0        0         1
LNDMC_TRIG_TIME  float       1.0      0.1      10.0
LNDMC_XY_VEL_MAX float       1.5        -         -
LNDMC_Z_VEL_MAX  float      0.25      0.0         -
MAV_COMP_ID      int           1        1       250
MAV_FWDEXTSP     int           1        0         1
MAV_HASH_CHK_EN  int           1        0         1
MAV_HB_FORW_EN   int           1        0         1
MAV_PROTO_VER    int           2        0         2
MAV_SYS_ID       int           1        1       250
MAV_TYPE         int           2        0        23
MC_PITCHRATE_MAX float     220.0      0.0    1800.0
MC_PITCH_P       float       6.5      0.0      12.0
MC_ROLLRATE_MAX  float     220.0      0.0    1800.0
MC_ROLL_P        float       6.5      0.0      12.0
MC_YAWRATE_MAX   float     200.0      0.0    1800.0
MC_YAW_P         float       2.8      0.0       5.0
MIS_COMMAND_TOUT float       0.0      0.0         -
MIS_TAKEOFF_ALT  float       2.5      0.0         -
MIS_YAW_ERR      float      12.0      0.0      90.0
MIS_YAW_TMT      float      -1.0     -1.0      20.0
MPC_ACC_DOWN_MAX float       3.0      2.0      15.0
MPC_ACC_HOR      float       3.0      2.0      15.0
MPC_ACC_HOR_MAX  float       5.0      2.0      15.0
MPC_ACC_UP_MAX   float       4.0      2.0      15.0
MPC_JERK_AUTO    float       4.0      1.0      80.0
MPC_LAND_ALT1    float      10.0      0.0     122.0
MPC_LAND_ALT2    float       5.0      0.0     122.0
MPC_LAND_SPEED   float       0.7      0.6         -
MPC_MANTHR_MIN   float      0.08      0.0       1.0
MPC_MAN_TILT_MAX float      35.0      1.0      70.0
MPC_MAN_Y_MAX    float     150.0      0.0     400.0
MPC_POS_MODE     int           4        0         4
MPC_THR_HOVER    float       0.5      0.1       0.8
MPC_THR_MAX      float       1.0      0.0       1.0
MPC_THR_MIN      float      0.12     0.05       0.5
MPC_TILTMAX_AIR  float      45.0     20.0      89.0
MPC_TILTMAX_LND  float      12.0      5.0      89.0
MPC_TKO_RAMP_T   float       3.0      0.0       5.0
MPC_TKO_SPEED    float       1.5      1.0       5.0
MPC_USE_HTE      int           1        0         1
MPC_VEL_MANUAL   float      10.0      3.0      20.0
MPC_XY_CRUISE    float       5.0      3.0      20.0
MPC_XY_P         float      0.95      0.0       2.0
MPC_XY_VEL_MAX   float      12.0      0.0      20.0
MPC_YAWRAUTO_MAX float      45.0      5.0     360.0
MPC_YAW_MODE     int           0        0         5
MPC_Z_P          float       1.0      0.1       1.5
MPC_Z_VEL_MAX_DN float       1.5      0.5       4.0
MPC_Z_VEL_MAX_UP float       3.0      0.5       8.0
MPC_Z_V_AUTO_DN  float       1.5      0.5       4.0
MPC_Z_V_AUTO_UP  float       3.0      0.5       8.0
NAV_ACC_RAD      float       2.0     0.05     200.0
NAV_DLL_ACT      int           0        0         6
NAV_LOITER_RAD   float      80.0     25.0    1000.0
NAV_MC_ALT_RAD   float       0.8     0.05     200.0
NAV_RCL_ACT      int           2        1         6
RC_CHAN_CNT      int           0        0        18
RC_MAP_FLTMODE   int           0        0        18
RC_MAP_KILL_SW   int           0        0        18
RC_MAP_MODE_SW   int           0        0        18
RC_MAP_PITCH     int           0        0        18
RC_MAP_RETURN_SW int           0        0        18
RC_MAP_ROLL      int           0        0        18
RC_MAP_THROTTLE  int           0        0        18
RC_MAP_YAW       int           0        0        18
RTL_CONE_ANG     int          45        0        90
RTL_DESCEND_ALT  float      10.0      0.0         -
RTL_LAND_DELAY   float       0.0     -1.0         -
RTL_MIN_DIST     float      10.0      0.5         -
RTL_RETURN_ALT   float      30.0      0.0         -
RTL_TYPE         int           0        0         4
SDLOG_MODE       int           1       -1         4
SDLOG_PROFILE    int         131        0      2047
SENS_BOARD_ROT   int           0        0        40
SENS_BOARD_X_OFF float       0.0        -         -
SENS_BOARD_Y_OFF float       0.0        -         -
SENS_BOARD_Z_OFF float       0.0        -         -
SYS_AUTOCONFIG   int           0        0         1
SYS_AUTOSTART    int       10040        0   9999999
SYS_FAILURE_EN   int           1        0         1
SYS_HAS_BARO     int           1        0         1
SYS_HAS_GPS      int           1        0         1
SYS_HAS_MAG      int           1        -         -
SYS_PARAM_VER    int           1        0         -
TRIG_MODE        int           0        0         4
"""


def _entry(kind: str, default: str, *limits: str) -> Entry:
    least, most = (None if limit == "-" else float(limit) for limit in limits)
    return Entry(int(default) if kind == "int" else float(default), least, most)


def _read(table: str) -> dict[str, Entry]:
    rows = (line.split() for line in table.strip().splitlines()[1:])
    return {name: _entry(*columns) for name, *columns in rows}


TABLE = _read(_TABLE)
"""By name, in the order of the names, which is that of the indices."""
