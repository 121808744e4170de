"""An embedded autopilot: a quadrotor with a slung load that speaks MAVLink 2.

`iolspi sitl --like px4` starts one; `server.Sitl` is the same inside a test:

    with Sitl("ardupilot", ["udpout:127.0.0.1:14550"], {"SIM_SPEEDUP": 4.0}) as sitl:
        ...

What is steered and told is north, east, down, as on the wire, and what flies is the quadrotor of
`sim_nodes.quadrotor`, east, north, up: this is the far side of the bridge, and shares nothing with
it but MAVLink and the task that both are about.
"""
