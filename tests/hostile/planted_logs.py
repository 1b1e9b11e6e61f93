"""Small whole logs of other programs: 1.6 s of a phone that lies still."""

from collections.abc import Callable

import numpy as np

from elfslam.data.importing import LogFormat

T_S = np.arange(80) * 0.02


def rows(values: str, separator: str, unit: float = 1.0, decimals: int = 6) -> str:
    return "\n".join(f"{t_s * unit:.{decimals}f}{separator}{values}" for t_s in T_S) + "\n"


def phyphox() -> dict[str, str]:
    head = '"Time (s)","X ({0})","Y ({0})","Z ({0})"\n'
    return {
        "Accelerometer.csv": head.format("m/s^2") + rows("0.1,0.2,9.8", ","),
        "Gyroscope.csv": head.format("rad/s") + rows("0.1,0.2,0.3", ","),
        "Magnetometer.csv": head.format("µT") + rows("1E1,2E1,-3E1", ","),
        "Sound.csv": '"Sound"\n' + "0.5\n-0.5\n" * 40_000,
        "Sound rate.csv": '"Sound rate (Hz)"\n48000\n',
        "meta/device.csv": '"property","value"\n"deviceModel","Pixel"\n',
        "meta/time.csv": '"event","experiment time"\n"START",0\n"PAUSE",1.6\n',
    }


def sensorlogger() -> dict[str, str]:
    head = "seconds_elapsed,z,y,x\n"
    networks = "seconds_elapsed,ssid,bssid,level\n0.5,home,aa,-50\n0.5,,bb,-60\n"
    return {
        "Metadata.csv": "device name,platform,standardisation\niPhone,ios,false\n",
        "Accelerometer.csv": head + rows("0.1,0.2,0.3", ","),
        "Gravity.csv": head + rows("-9.8,0,0", ","),
        "Gyroscope.csv": head + rows("0.1,0.2,0.3", ","),
        "Magnetometer.csv": head + rows("10,20,30", ","),
        "Orientation.csv": "seconds_elapsed,qx,qy,qz,qw\n" + rows("0,0,0,1", ","),
        "WiFi.csv": networks,
    }


def ronin() -> dict[str, str]:
    return {
        "acce.txt": "# Created\n" + rows("0.1 0.2 9.8", " ", 1e9, 0),
        "gyro.txt": "# Created\n" + rows("0.1 0.2 0.3", " ", 1e9, 0),
        "magnet.txt": rows("10 20 30", " ", 1e9, 0),
        "rv.txt": rows("0 0 0 1", " ", 1e9, 0),
        "info.json": '{"device": "asus4"}',
    }


def getsensordata() -> dict[str, str]:
    kinds = {"ACCE": "0.1;0.2;9.8;3", "GYRO": "0.1;0.2;0.3;3", "AHRS": "0;0;0;0;0;0;3"}
    lines = [f"{kind};{t:.3f};{t + 7:.3f};{cells}" for kind, cells in kinds.items() for t in T_S]
    places = ["POSI;0.5;1;40.1;-3.5;1;1", "POSI;1.5;2;40.1001;-3.5;1;1"]
    networks = ["WIFI;0.5;1;home;00:0b:86:27:36:c1;2412;-70"]
    return {"walk.txt": "\n".join(["% Model: Pixel", *lines, *places, *networks]) + "\n"}


LOGS: dict[LogFormat, Callable[[], dict[str, str]]] = {
    LogFormat.PHYPHOX: phyphox,
    LogFormat.SENSORLOGGER: sensorlogger,
    LogFormat.RONIN: ronin,
    LogFormat.GETSENSORDATA: getsensordata,
}
