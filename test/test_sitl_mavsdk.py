"""MAVSDK, which shares no code with us, flies the embedded autopilot."""

import time

import pytest
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action, ActionResult
from mavsdk.plugins.gripper import Gripper, GripperResult
from mavsdk.plugins.offboard import Offboard, OffboardResult, VelocityNedYaw
from mavsdk.plugins.param import Param, ParamResult
from mavsdk.plugins.telemetry import FlightMode, Telemetry

from sim_nodes.autopilot.firmware import WITH_GRIPPER
from sim_nodes.autopilot.server import Sitl

pytestmark = pytest.mark.slow
SPEED_UP = 2.0


def wait(holds, deadline=120.0):
    end = time.monotonic() + deadline
    while not holds():
        assert time.monotonic() < end, "it never came about"
        time.sleep(0.01)


@pytest.fixture
def mavsdk():
    client = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    yield client
    client.destroy()


def connect(mavsdk, sitl):
    mavsdk.add_any_connection(f"udpout://127.0.0.1:{sitl.addresses[0][1]}")
    system = mavsdk.first_autopilot(10.0)
    assert system is not None
    return system


WHOLE = {"px4": ("COM_OBL_RC_ACT", 4), "ardupilot": ("ANGLE_MAX", 4500)}
ASKED = ("SYS_STATUS", "EKF_STATUS_REPORT", "GPS_RAW_INT", "HOME_POSITION", "ATTITUDE",
         "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "EXTENDED_SYS_STATE", "SYSTEM_TIME",
         "BATTERY_STATUS", "VFR_HUD")  # fmt: skip
BROKEN = {"px4": "COM_OF_LOSS_T", "ardupilot": "GUID_TIMEOUT"}


@pytest.mark.parametrize("like", ["px4", "ardupilot"])
def test_mavsdk_sets_parameters_and_lets_the_load_go(mavsdk, like):
    with Sitl(like, ["udpin:127.0.0.1:0"], {"SIM_SPEEDUP": SPEED_UP} | WITH_GRIPPER[like]) as sitl:
        system = connect(mavsdk, sitl)
        parameters = Param(system)
        own = sitl.autopilot.parameters
        name, value = WHOLE[like]
        assert parameters.get_param_int(name) == own[name]
        assert parameters.set_param_int(name, value) == ParamResult.SUCCESS
        assert own[name] == value
        assert parameters.get_param_float(BROKEN[like]) == own[BROKEN[like]]
        parameters.set_param_float(BROKEN[like], 0.75)
        assert own[BROKEN[like]] == 0.75
        if like == "px4":  # of whose gripper's two answers MAVSDK's blocking call takes the first
            assert Action(system).set_actuator(1, 1.0) == ActionResult.SUCCESS
        else:
            assert Gripper(system).release(1) == GripperResult.SUCCESS
        wait(lambda: not sitl.autopilot.body.attached)


@pytest.mark.parametrize("like", ["px4", "ardupilot"])
def test_mavsdk_connects_arms_takes_off_flies_and_lands(mavsdk, like):
    urls, parameters = ["udpin:127.0.0.1:0"], {"SIM_SPEEDUP": SPEED_UP}
    with Sitl(like, urls, parameters, ready_after=2.0) as sitl:
        system = connect(mavsdk, sitl)
        if like == "ardupilot":  # it sends what it is asked for, and this client does not ask
            with sitl.lock:
                for name in ASKED:
                    sitl.autopilot.links[0].set_rate(name, 4.0)
        telemetry, action, offboard = Telemetry(system), Action(system), Offboard(system)
        wait(telemetry.health_all_ok)
        assert action.set_takeoff_altitude(3.0) == ActionResult.SUCCESS
        assert action.arm() == ActionResult.SUCCESS
        assert action.takeoff() == ActionResult.SUCCESS
        wait(lambda: telemetry.position_velocity_ned().position.down_m < -2.8)

        offboard.set_velocity_ned(VelocityNedYaw(0.0, 0.0, 0.0, 0.0))
        assert offboard.start() == OffboardResult.SUCCESS
        wait(lambda: telemetry.flight_mode() == FlightMode.OFFBOARD)
        offboard.set_velocity_ned(VelocityNedYaw(1.5, -1.0, 0.0, 0.0))
        wait(lambda: telemetry.position_velocity_ned().position.north_m > 3.0)
        flown = telemetry.position_velocity_ned().position
        # Two thirds as far west as north; what it estimates is wrong by 0.2 m, and 0.3 m/s.
        assert -0.67 * flown.north_m - 0.9 < flown.east_m < -0.67 * flown.north_m + 0.9
        wait(lambda: telemetry.position_velocity_ned().velocity.north_m_s > 1.2)
        wait(lambda: telemetry.position_velocity_ned().velocity.east_m_s < -0.8)
        assert flown.down_m == pytest.approx(-3.0, abs=0.6)

        assert offboard.stop() == OffboardResult.SUCCESS
        wait(lambda: telemetry.flight_mode() != FlightMode.OFFBOARD or like == "ardupilot")
        assert action.land() == ActionResult.SUCCESS
        wait(lambda: not telemetry.armed())
        assert sitl.autopilot.body.landed
        assert not sitl.autopilot.body.broken
