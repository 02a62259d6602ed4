//! What moves while the shutter is open, smeared along its way.

use super::Crop;
use std::collections::HashMap;
use wide::f32x4;

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
    pub fn at(&self, width: usize, crop: Crop, column: usize, row: usize) -> (f32, f32) {
        let at = row * width + column;
        let depth = self.depth[at];
        if !depth.is_finite() {
            return (0.0, 0.0);
        }
        let way = self.labels.get(at).and_then(|label| self.moving.get(label)).unwrap_or(&self.still);
        self.along(way, depth, crop, column, row)
    }

    /// Pixels that what moves so far is moved at a pixel.
    fn along(&self, way: &[f32; 3], depth: f32, crop: Crop, column: usize, row: usize) -> (f32, f32) {
        let axis = crop.axis();
        let x = (column as f32 + 0.5 - axis.0) / self.focal;
        let y = (row as f32 + 0.5 - axis.1) / self.focal;
        let scale = self.focal / depth;
        ((way[0] - x * way[2]) * scale, (way[1] - y * way[2]) * scale)
    }

    /// One row's reds, greens and blues, each pixel smeared along its way.
    pub(super) fn gather(&self, plane: &Plane, crop: Crop, row: usize, out: &mut [f32]) {
        let here = row * plane.width..(row + 1) * plane.width;
        // Neighbours mostly show the same thing: its way is looked up where another one begins.
        let (mut shown, mut way) = (None, &self.still);
        let [reds, greens, blues] = super::channels_mut(out);
        for (column, (at, ((red, green), blue))) in here.zip(reds.iter_mut().zip(greens).zip(blues)).enumerate() {
            let label = self.labels.get(at);
            if label != shown {
                shown = label;
                way = label.and_then(|label| self.moving.get(label)).unwrap_or(&self.still);
            }
            [*red, *green, *blue, _] = self.smeared(plane, way, crop, column, row).to_array();
        }
    }

    /// What a pixel takes up from all that passes it, where it moves so far.
    fn smeared(&self, plane: &Plane, way: &[f32; 3], crop: Crop, column: usize, row: usize) -> f32x4 {
        let depth = self.depth[row * plane.width + column];
        if !depth.is_finite() {
            return plane.at(column, row);
        }
        let (dx, dy) = self.along(way, depth, crop, column, row);
        let length = (dx * dx + dy * dy).sqrt();
        if length < SHARP_PX {
            return plane.at(column, row);
        }
        // Points half a pixel apart, evenly over the way, the pixel's own middle in their middle.
        let shorten = (LONGEST_PX / length).min(1.0);
        let count = 2 + (2.0 * length * shorten) as i32;
        let here = f32x4::from([column as f32, row as f32, 0.0, 0.0]);
        let (way, step) = (f32x4::from([dx, dy, 0.0, 0.0]) * shorten, 1.0 / count as f32);
        let seen = |point: i32| plane.between(here + way * ((point as f32 + 0.5) * step - 0.5));
        (0..count).fold(f32x4::ZERO, |sum, point| sum + seen(point)) * step
    }
}

/// A whole picture's light, for pixels that take from anywhere around them.
pub struct Plane {
    width: usize,
    height: usize,
    /// Red, green, blue and nothing, which a processor reads in one go; (height + 1) × (width + 1), the last row and
    /// column twice, so that every pixel has one beside and one below it.
    pixels: Vec<f32x4>,
}

impl Plane {
    /// `fill` makes one row's reds, greens and blues.
    pub fn of((width, height): (usize, usize), fill: impl Fn(usize, &mut [f32]) + Sync) -> Self {
        let mut pixels = vec![f32x4::ZERO; (width + 1) * (height + 1)];
        super::in_bands(width + 1, &mut pixels, |first, band| {
            let mut line = vec![0.0_f32; width * 3];
            for (row, pixels) in (first..).zip(band.chunks_exact_mut(width + 1)) {
                fill(row.min(height - 1), &mut line);
                let [reds, greens, blues] = super::channels(&line);
                for (pixel, ((red, green), blue)) in pixels.iter_mut().zip(reds.iter().zip(greens).zip(blues)) {
                    *pixel = f32x4::from([*red, *green, *blue, 0.0]);
                }
                pixels[width] = pixels[width - 1];
            }
        });
        Self { width, height, pixels }
    }

    fn at(&self, column: usize, row: usize) -> f32x4 {
        self.pixels[row * (self.width + 1) + column]
    }

    /// At (x, y), linear between the middles of pixels; edges go on outwards.
    fn between(&self, place: f32x4) -> f32x4 {
        let last = f32x4::from([(self.width - 1) as f32, (self.height - 1) as f32, 0.0, 0.0]);
        let place = place.fast_max(f32x4::ZERO).fast_min(last);
        let whole = place.fast_trunc_int();
        let ([along, down, ..], [left, top, ..]) = ((place - whole.round_float()).to_array(), whole.to_array());
        let start = top as usize * (self.width + 1) + left as usize;
        let (upper, lower) = (&self.pixels[start..][..2], &self.pixels[start + self.width + 1..][..2]);
        let (above, below) = (upper[0] + (upper[1] - upper[0]) * along, lower[0] + (lower[1] - lower[0]) * along);
        above + (below - above) * down
    }
}
