"""The formats of logs by name: what writes them, an example, and the configuration for devices that do.

Formats whose lines are tagged have a reader of their own; all others are tables, which one reader understands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from fbgraph.tables.table import Table

Preset = Literal["phone", "m5stickc"]


@dataclass(frozen=True)
class LogFormat:
    """A format.

    Attributes:
        name: as ``--format`` and the summary have it.
        description: one line.
        example: a few lines of such a log.
        preset: the configuration for devices that write it.
        tested: on what its reading was tried: ``real logs``, or ``examples`` made after its documentation.
        app: as ``columns.app_layouts`` knows it; "" if its names need no explaining.
        columns: names that its tables have, where they tell it from others.
    """

    name: str
    description: str
    example: str
    preset: Preset = "phone"
    tested: Literal["real logs", "examples"] = "examples"
    app: str = ""
    columns: tuple[str, ...] = ()


M5STICKC = LogFormat(
    "m5stickc",
    "M5StickC and other IMU loggers, one table (t_ms,ax_g,…,gx_dps,…,mx_ut,…,p_hpa)",
    """\
t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps,mx_ut,my_ut,mz_ut,p_hpa,temp_c,event
10250,0.012,-0.034,0.998,1.22,-0.61,0.31,21.4,-3.2,-40.1,1013.25,31.5,
10260,0.015,-0.031,1.002,1.10,-0.55,0.37,,,,,,button
""",
    "m5stickc",
    "real logs",
)
_SENSOR_LOGGER = """\
time,seconds_elapsed,z,y,x
1766385749437101600,0.1081,9.3727,2.1655,0.2393
"""
TABLE_FORMATS = (
    M5STICKC,
    LogFormat(
        "phyphox",
        "phyphox, folder or zip: a CSV a sensor, any of its separators",
        '"Time (s)","X (m/s^2)","Y (m/s^2)","Z (m/s^2)"\n1.99E-3,-1.2188,5.2331,8.2326\n',
        tested="real logs",
        columns=("Time (s)", "X (m/s^2)"),
    ),
    LogFormat(
        "sensor_logger",
        "Sensor Logger (Android, iOS), folder, zip or JSON: TotalAcceleration, or Accelerometer and Gravity",
        _SENSOR_LOGGER,
        tested="real logs",
        app="Sensor Logger",
    ),
    LogFormat(
        "physics_toolbox",
        "Physics Toolbox Sensor Suite, multi-record CSV",
        "time,gFx,gFy,gFz,wx,wy,wz,p,Bx,By,Bz\n0.012,0.01,0.02,0.99,0.1,0.0,0.2,1013.2,20.1,-3.0,-40.2\n",
        app="Physics Toolbox Sensor Suite",
    ),
    LogFormat(
        "androsensor",
        "AndroSensor",
        "ACCELEROMETER X (m/s²);ACCELEROMETER Y (m/s²);ACCELEROMETER Z (m/s²);…;Time since start in ms\n",
        columns=("ACCELEROMETER X (m/s²)", "Time since start in ms"),
    ),
    LogFormat(
        "openlog_artemis",
        "SparkFun OpenLog Artemis (ICM-20948, whose magnetometer has axes of its own)",
        "rtcDate,rtcTime,aX,aY,aZ,gX,gY,gZ,mX,mY,mZ,imu_degC,output_Hz,\n",
        "m5stickc",
        app="OpenLog Artemis",
    ),
    LogFormat(
        "xsens",
        "Xsens MT export (SampleTimeFine is 0.1 ms)",
        "PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z,Mag_X,Mag_Y,Mag_Z\n",
        "m5stickc",
        app="Xsens MT",
    ),
    LogFormat(
        "ros_csv",
        "rostopic echo -p of sensor_msgs/Imu",
        "%time,field.header.stamp,field.angular_velocity.x,…,field.linear_acceleration.x,…\n",
        app="rostopic echo -p",
    ),
    LogFormat(
        "euroc",
        "EuRoC/ASL imu0/data.csv",
        "#timestamp [ns],w_RS_S_x [rad s^-1],…,a_RS_S_x [m s^-2],…\n",
        columns=("w_RS_S_x [rad s^-1]",),
    ),
    LogFormat(
        "sensorlog_ios",
        "SensorLog for iOS",
        "loggingTime(txt),accelerometerAccelerationX(G),…,gyroRotationX(rad/s),…\n",
        app="SensorLog (iOS)",
    ),
    LogFormat(
        "ridi",
        "RIDI and RoNIN tables with their truth",
        "time,gyro_x,gyro_y,gyro_z,acce_x,acce_y,acce_z,magnet_x,…,pos_x,pos_y,pos_z,…\n",
        tested="real logs",
        columns=("acce_x", "gyro_x", "magnet_x"),
    ),
    LogFormat(
        "table",
        "any other table, folder or zip of tables: columns found by name, unit and what they show",
        M5STICKC.example,
        tested="examples",
        columns=("?",),
    ),
)
"""Those that are read as tables."""


def format_of(apps: Sequence[str], tables: Sequence[Table]) -> LogFormat:
    """The format that some tables are of.

    Args:
        apps: that are known to have written the tables in use.
        tables: of the log.
    """
    named = next((known for known in TABLE_FORMATS if known.app and known.app in apps), None)
    if named is not None:
        return named
    there = [{column.name.strip() for column in table.columns} for table in tables]
    for known in TABLE_FORMATS:
        if known.columns and any(set(known.columns) <= names for names in there):
            return known
    return TABLE_FORMATS[-1] if len(tables) > 1 else M5STICKC
