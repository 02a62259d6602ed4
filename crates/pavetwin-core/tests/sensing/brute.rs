//! The definition of visibility, cell by cell in three dimensions: a line of sight against boxes, cylinders and prisms.
//!
//! Shares no formula with the kernel: nothing here is projected on the ground. `slack_m` makes every body larger (or,
//! when negative, smaller), so that cells within rounding of a shadow's rim can be told from true disagreements.

use pavetwin_core::geometry::Vec2;
use pavetwin_core::sensing::{AgentPose, BodyClass, Prism, Viewpoint, Window};

/// The part of a line of sight, as shares of its length, that satisfies all conditions so far.
#[derive(Clone, Copy)]
struct Part {
    from: f64,
    to: f64,
}

impl Part {
    const WHOLE: Self = Self { from: 0.0, to: 1.0 };

    /// Keeps the part in which `start + share · rate` is in `[low, high]`.
    fn within(self, start: f64, rate: f64, low: f64, high: f64) -> Self {
        if rate == 0.0 {
            return if start >= low && start <= high { self } else { Self { from: 1.0, to: 0.0 } };
        }
        let (a, b) = ((low - start) / rate, (high - start) / rate);
        Self { from: self.from.max(a.min(b)), to: self.to.min(a.max(b)) }
    }

    fn exists(self) -> bool {
        self.from <= self.to
    }
}

fn heights(altitude_m: f64, base_m: f64, top_m: f64, slack_m: f64) -> Part {
    // The ground itself is never made to count as below a body that stands on it.
    let low = if base_m == 0.0 { -1.0 } else { base_m - slack_m };
    Part::WHOLE.within(altitude_m, -altitude_m, low, top_m + slack_m)
}

pub fn agent_hides(from: &Viewpoint, cell: Vec2, pose: &AgentPose, slack_m: f64) -> bool {
    let part = heights(from.altitude_m, pose.body.base_m, pose.body.height_m, slack_m);
    let start = from.position - pose.position;
    let run = cell - from.position;
    match pose.body.class {
        BodyClass::Vehicle => {
            let (ahead, half_m) = (Vec2::from_yaw(pose.yaw_rad), 0.5 * pose.body.length_m + slack_m);
            let part = part.within(start.dot(ahead), run.dot(ahead), -half_m, half_m);
            let (side, half_m) = (ahead.left(), 0.5 * pose.body.width_m + slack_m);
            part.within(start.dot(side), run.dot(side), -half_m, half_m).exists()
        }
        BodyClass::Pedestrian => {
            // |start + share · run|² = radius², a quadratic in the share.
            let radius_m = 0.5 * pose.body.width_m + slack_m;
            let (a, b, c) = (run.dot(run), start.dot(run), start.dot(start) - radius_m * radius_m);
            if a == 0.0 {
                return c <= 0.0 && part.exists();
            }
            let discriminant = b * b - a * c;
            if discriminant < 0.0 {
                return false;
            }
            let root = discriminant.sqrt();
            part.from.max((-b - root) / a) <= part.to.min((-b + root) / a)
        }
    }
}

pub fn solid_hides(from: &Viewpoint, cell: Vec2, prism: &Prism, slack_m: f64) -> bool {
    let mut part = heights(from.altitude_m, prism.base_m(), prism.top_m(), slack_m);
    let base = prism.base();
    for (i, &a) in base.iter().enumerate() {
        let inward = (base[(i + 1) % base.len()] - a).left().normalized();
        let (start, rate) = ((from.position - a).dot(inward), (cell - from.position).dot(inward));
        part = part.within(start, rate, -slack_m, f64::INFINITY);
    }
    part.exists()
}

pub fn in_window(from: &Viewpoint, window: Window, cell: Vec2, slack_m: f64) -> bool {
    let wider = Window { half_along_m: window.half_along_m + slack_m, half_across_m: window.half_across_m + slack_m };
    from.place(wider).contains(cell)
}
