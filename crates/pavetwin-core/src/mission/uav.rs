//! x_t without the battery: where the UAV is, which way it looks, how fast it moves.

use crate::geometry::Vec2;
use crate::navigation::Motion;
use crate::sensing::Viewpoint;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct UavState {
    pub position: Vec2,
    pub altitude_m: f64,
    pub yaw_rad: f64,
    pub speed_mps: f64,
}

impl UavState {
    pub fn on_the_ground_at(position: Vec2) -> Self {
        Self { position, altitude_m: 0.0, yaw_rad: 0.0, speed_mps: 0.0 }
    }

    pub fn viewpoint(&self) -> Viewpoint {
        Viewpoint { position: self.position, altitude_m: self.altitude_m, yaw_rad: self.yaw_rad }
    }

    /// Takes over the pose and the speed of a movement; the altitude stays.
    pub fn take_pose(&mut self, motion: &(impl Motion + ?Sized)) {
        self.position = motion.position();
        self.yaw_rad = motion.yaw_rad();
        self.speed_mps = motion.speed_mps();
    }
}
