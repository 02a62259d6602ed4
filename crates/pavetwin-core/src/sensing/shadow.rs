//! What a body hides of the ground.
//!
//! From a camera at altitude H, the point c on the ground is hidden by a body with convex base B between the heights
//! z0 and z1 when the line to it passes over B within those heights: at height z the line is at
//! q + (c − q)·(H − z)/H, with q the nadir. So the shadow is the union of q + (B − q)·s over the scales
//! s = H/(H − z), z in [z0, z1]; for a convex B that union is convex, the hull of its two ends.

use super::raster::Spans;
use super::solids::Solid;
use super::trace::AgentPose;
use super::trace_columns::BodyClass;
use crate::geometry::Vec2;

/// How far below the camera a body that reaches as high as the camera, or higher, is cut off: as a share of the
/// altitude. Above that, a line of sight has moved less than a millionth of its length on the ground, so that the cut
/// changes nothing for cells of 0.25 m, and it keeps the scales finite.
const HEADROOM: f64 = 1.0e-6;

/// A camera's centre.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Eye {
    pub(crate) nadir: Vec2,
    pub(crate) altitude_m: f64,
}

/// The scales about the nadir by which a body's lower and upper end are thrown on the ground.
#[derive(Debug, Clone, Copy)]
struct Scales {
    near: f64,
    far: f64,
}

impl Eye {
    /// `None` for a body that is wholly above the camera, and so hides nothing.
    fn scales(&self, base_m: f64, top_m: f64) -> Option<Scales> {
        let highest_m = self.altitude_m * (1.0 - HEADROOM);
        let scale = |height_m: f64| self.altitude_m / (self.altitude_m - height_m);
        (base_m < highest_m).then(|| Scales { near: scale(base_m), far: scale(top_m.min(highest_m)) })
    }
}

/// The shadow of one body.
#[derive(Debug, Clone, Default)]
pub(crate) struct Shadow {
    /// Corners of a convex shadow, counter-clockwise; empty for that of a cylinder, and for no shadow.
    corners: Vec<Vec2>,
    cylinder: Option<Cylinder>,
}

#[derive(Debug, Clone, Copy)]
struct Cylinder {
    eye: Eye,
    scales: Scales,
    /// The cylinder's axis, from the nadir.
    axis: Vec2,
    radius_m: f64,
}

impl Shadow {
    /// Becomes the shadow of an agent: of a box for a vehicle, of an upright cylinder for a pedestrian.
    pub(crate) fn of_agent(&mut self, eye: Eye, pose: &AgentPose) {
        let body = &pose.body;
        match body.class {
            BodyClass::Vehicle => {
                let ahead = Vec2::from_yaw(pose.yaw_rad);
                let (along, across) = (ahead * (0.5 * body.length_m), ahead.left() * (0.5 * body.width_m));
                let at = pose.position;
                let base = [at + along + across, at - along + across, at - along - across, at + along - across];
                self.of_prism(eye, &base, body.base_m, body.height_m);
            }
            BodyClass::Pedestrian => {
                self.corners.clear();
                self.cylinder = eye.scales(body.base_m, body.height_m).map(|scales| Cylinder {
                    eye,
                    scales,
                    axis: pose.position - eye.nadir,
                    radius_m: 0.5 * body.width_m,
                });
            }
        }
    }

    /// Becomes the shadow of a static solid.
    pub(crate) fn of_solid(&mut self, eye: Eye, solid: &Solid) {
        self.of_prism(eye, solid.base, solid.base_m, solid.top_m);
    }

    /// Becomes the shadow of an upright prism with a convex, counter-clockwise base.
    ///
    /// An edge that turns its outer side to the nadir bounds the shadow on the near side, where the lower scale counts;
    /// any other edge bounds it on the far side. Where the two sides meet, the corner appears at both scales.
    fn of_prism(&mut self, eye: Eye, base: &[Vec2], base_m: f64, top_m: f64) {
        self.corners.clear();
        self.cylinder = None;
        let Some(scales) = eye.scales(base_m, top_m) else { return };
        let Some(&last) = base.last() else { return };
        let is_far = |from: Vec2, to: Vec2| (to - from).cross(eye.nadir - from) >= 0.0;
        let scale_of = |far: bool| if far { scales.far } else { scales.near };
        let mut arrived_far = is_far(last, base[0]);
        for (i, &corner) in base.iter().enumerate() {
            let leaves_far = is_far(corner, base[(i + 1) % base.len()]);
            let offset = corner - eye.nadir;
            self.corners.push(eye.nadir + offset * scale_of(arrived_far));
            if leaves_far != arrived_far {
                self.corners.push(eye.nadir + offset * scale_of(leaves_far));
            }
            arrived_far = leaves_far;
        }
    }

    /// Whether the shadow covers a point on the ground, its rim included.
    pub(crate) fn covers(&self, point: Vec2) -> bool {
        match &self.cylinder {
            Some(cylinder) => cylinder.hides(point),
            None => match self.corners.last() {
                Some(&last) => {
                    let mut from = last;
                    self.corners.iter().all(|&to| {
                        let is_left = (to - from).cross(point - from) >= 0.0;
                        from = to;
                        is_left
                    })
                }
                None => false,
            },
        }
    }

    /// Fills the shadow; returns whether there is one.
    pub(crate) fn fill(&self, spans: &mut Spans) -> bool {
        match &self.cylinder {
            Some(cylinder) => {
                cylinder.fill(spans);
                true
            }
            None if self.corners.is_empty() => false,
            None => {
                spans.polygon(&self.corners);
                true
            }
        }
    }
}

impl Cylinder {
    /// Whether the line of sight, seen from above, passes within a radius of the axis while it is inside the heights.
    fn hides(&self, point: Vec2) -> bool {
        let offset = point - self.eye.nadir;
        let (from, to) = (offset * (1.0 / self.scales.far), offset * (1.0 / self.scales.near));
        let run = to - from;
        let length_squared = run.dot(run);
        let along =
            if length_squared > 0.0 { ((self.axis - from).dot(run) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
        let apart = self.axis - (from + run * along);
        apart.dot(apart) <= self.radius_m * self.radius_m
    }

    fn fill(&self, spans: &mut Spans) {
        let Scales { near, far } = self.scales;
        let disc = |scale: f64| (self.eye.nadir + self.axis * scale, self.radius_m * scale);
        let distance_squared = self.axis.dot(self.axis);
        let beyond = distance_squared - self.radius_m * self.radius_m;
        // Below the camera itself the upper end covers the lower; elsewhere both are touched by the two lines through
        // the nadir that touch the cylinder.
        let tangents = (beyond > 0.0).then(|| {
            let foot = self.axis * (beyond / distance_squared);
            let side = self.axis.left() * (self.radius_m * beyond.sqrt() / distance_squared);
            let touch = |point: Vec2, scale: f64| self.eye.nadir + point * scale;
            [touch(foot - side, near), touch(foot - side, far), touch(foot + side, far), touch(foot + side, near)]
        });
        spans.discs(disc(near), disc(far), tangents);
    }
}
