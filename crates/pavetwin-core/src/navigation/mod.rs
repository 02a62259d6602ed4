//! Where the UAV may fly and how it moves there: navigation mesh, routes, rails, kinematics, avoidance.
