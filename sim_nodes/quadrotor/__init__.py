"""A quadrotor with six degrees of freedom and a load on a cable: pure functions, compiled.

East, north, up outside; forward, left, up on the body. `body` moves it, `control` steers it,
`wind` blows, `flight` joins the three for one vehicle or many.
"""
