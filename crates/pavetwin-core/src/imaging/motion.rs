//! What moves while the shutter is open, smeared along its way.

use std::collections::HashMap;

/// Motion of every pixel over the exposure, from its depth and from who is seen there.
pub struct Motion<'a> {
    /// (height × width) metres along the axis; infinite where nothing is.
    pub depth: &'a [f32],
    /// (height × width), or empty.
    pub labels: &'a [u32],
    /// Focal length in pixels.
    pub focal: f32,
    /// Metres that what stands still moves in the camera's frame (x right, y down, z forward) over the exposure.
    pub still: [f32; 3],
    /// Likewise of labelled things that move.
    pub moving: HashMap<u32, [f32; 3]>,
}

/// Less than this is left sharp.
const SHARP_PX: f32 = 0.3;

/// Longer ways are not followed.
const LONGEST_PX: f32 = 64.0;

impl Motion<'_> {
    /// Pixels that the image moves at a pixel.
    pub fn at(&self, width: usize, height: usize, column: usize, row: usize) -> (f32, f32) {
        let at = row * width + column;
        let depth = self.depth[at];
        if !depth.is_finite() {
            return (0.0, 0.0);
        }
        let way = self.labels.get(at).and_then(|label| self.moving.get(label)).unwrap_or(&self.still);
        self.along(way, depth, (width, height), column, row)
    }

    /// Pixels that what moves so far is moved at a pixel.
    fn along(
        &self,
        way: &[f32; 3],
        depth: f32,
        (width, height): (usize, usize),
        column: usize,
        row: usize,
    ) -> (f32, f32) {
        let x = (column as f32 + 0.5 - 0.5 * width as f32) / self.focal;
        let y = (row as f32 + 0.5 - 0.5 * height as f32) / self.focal;
        let scale = self.focal / depth;
        ((way[0] - x * way[2]) * scale, (way[1] - y * way[2]) * scale)
    }

    pub(super) fn gather(&self, plane: &[f32], (width, height): (usize, usize), row: usize, out: &mut [f32]) {
        out.copy_from_slice(&plane[row * width * 3..][..width * 3]);
        let depths = &self.depth[row * width..][..width];
        // Neighbours mostly show the same thing: its way is looked up where another one begins.
        let (mut shown, mut way) = (None, &self.still);
        for (column, (out, depth)) in out.chunks_exact_mut(3).zip(depths).enumerate() {
            if !depth.is_finite() {
                continue;
            }
            let label = self.labels.get(row * width + column);
            if label != shown {
                shown = label;
                way = label.and_then(|label| self.moving.get(label)).unwrap_or(&self.still);
            }
            let (dx, dy) = self.along(way, *depth, (width, height), column, row);
            let length = (dx * dx + dy * dy).sqrt();
            if length < SHARP_PX {
                continue;
            }
            // Points half a pixel apart, evenly over the way, the pixel's own middle in their middle.
            let shorten = (LONGEST_PX / length).min(1.0);
            let count = (2.0 * length * shorten).ceil() as usize + 1;
            let mut sum = [0.0_f32; 3];
            for point in 0..count {
                let share = ((point as f32 + 0.5) / count as f32 - 0.5) * shorten;
                let seen = between(plane, (width, height), column as f32 + dx * share, row as f32 + dy * share);
                for channel in 0..3 {
                    sum[channel] += seen[channel];
                }
            }
            for channel in 0..3 {
                out[channel] = sum[channel] / count as f32;
            }
        }
    }
}

/// Linear between the middles of pixels; edges go on outwards.
fn between(plane: &[f32], (width, height): (usize, usize), x: f32, y: f32) -> [f32; 3] {
    let (x, y) = (x.clamp(0.0, (width - 1) as f32), y.clamp(0.0, (height - 1) as f32));
    let (left, top) = (x as usize, y as usize);
    let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let (along, down) = (x - left as f32, y - top as f32);
    let pixel = |column: usize, row: usize| &plane[(row * width + column) * 3..][..3];
    let (a, b, c, d) = (pixel(left, top), pixel(right, top), pixel(left, bottom), pixel(right, bottom));
    std::array::from_fn(|channel| {
        let upper = a[channel] * (1.0 - along) + b[channel] * along;
        let lower = c[channel] * (1.0 - along) + d[channel] * along;
        upper * (1.0 - down) + lower * down
    })
}
