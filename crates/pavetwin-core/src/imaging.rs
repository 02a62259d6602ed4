//! From the light that a lens lets through to the picture that a camera stores: lens blur, motion over the exposure,
//! vignetting, electrons and their noise, white balance, tone, sharpening, 8 bits.

mod edges;
mod film;
mod light;
mod mosaic;
mod motion;
mod noise;
mod window;

pub use light::Light;
pub use mosaic::Mosaic;
pub use motion::Motion;

use edges::Tones;
use film::Film;
use motion::Plane;
use window::Window;

/// What the camera does to light. Light is in kcd/m², colours are linear sRGB until the tone curve.
#[derive(Clone, Debug)]
pub struct Sensor {
    /// Electrons of one output pixel for each kcd/m², over the exposure.
    pub electrons_per_light: f32,
    /// Electrons at which a pixel is full, at this ISO.
    pub full_electrons: f32,
    /// Standard deviation of the electronics, in electrons.
    pub read_electrons: f32,
    /// Share of the light that is missing in the corners.
    pub vignetting: f32,
    /// Standard deviation of the lens's point spread in pixels.
    pub blur_px: f32,
    /// Gains of red, green and blue.
    pub white_balance: [f32; 3],
    /// Distance of colours from grey, 1 as they are.
    pub saturation: f32,
    /// How much of the difference to its neighbours is added to a pixel.
    pub sharpening: f32,
    /// Output 0 … 1 at inputs (i / (n − 1))², so that the dark end is fine.
    pub curve: Vec<f32>,
    /// Where a pixel of the picture is one of the sensor; None where it is the mean of many.
    pub mosaic: Option<Mosaic>,
}

/// Where a picture lies in the camera's whole frame, whose middle the lens's axis goes through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crop {
    /// Width and height of the whole frame in pixels.
    pub frame: (usize, usize),
    /// Column and row of the picture's first pixel in it.
    pub corner: (usize, usize),
}

impl Crop {
    /// The whole frame.
    pub fn whole(frame: (usize, usize)) -> Self {
        Self { frame, corner: (0, 0) }
    }

    /// From the picture's upper left corner to where the axis goes through, in pixels.
    fn axis(&self) -> (f32, f32) {
        let (frame, corner) = (self.frame, self.corner);
        (0.5 * frame.0 as f32 - corner.0 as f32, 0.5 * frame.1 as f32 - corner.1 as f32)
    }
}

/// Rows are worked on in bands, on all cores: `work` is told each band's first row. What it fills a row with must not
/// depend on the band, so that the result does not depend on how many cores there are.
fn in_bands<T: Send>(row_length: usize, out: &mut [T], work: impl Fn(usize, &mut [T]) + Sync) {
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get()).min(8);
    let band = (out.len() / row_length).div_ceil(cores).max(1);
    std::thread::scope(|scope| {
        for (index, chunk) in out.chunks_mut(band * row_length).enumerate() {
            let work = &work;
            scope.spawn(move || work(index * band, chunk));
        }
    });
}

impl Sensor {
    /// The picture, (height × width × 3) values of sRGB.
    pub fn expose(&self, light: &Light<'_>, crop: Crop, motion: Option<&Motion<'_>>, seed: u64) -> Vec<u8> {
        let size = (light.width, light.height);
        let tones = self.tones(light);
        // Light that is stored as white: what is brighter would widen an edge by whole steps of its stairs.
        let white = self.white_balance.map(|gain| self.full_electrons / self.electrons_per_light / gain);
        let smooth = |row: usize, line: &mut [f32]| {
            light.line(row, line);
            tones.smooth(row, line, white, |column, row| light.pixel(column, row));
        };
        match motion {
            None => self.picture(size, crop, seed, smooth),
            Some(motion) => {
                let plane = Plane::of(size, smooth);
                self.picture(size, crop, seed, |row, line| motion.gather(&plane, crop, row, line))
            }
        }
    }

    /// What is stored of rows of light as `seen` fills them: each goes through the lens, is developed and sharpened
    /// while its neighbours are at hand. A row holds its reds, then its greens, then its blues: what is done to all of
    /// them a processor does to many at once.
    fn picture(&self, size: (usize, usize), crop: Crop, seed: u64, seen: impl Fn(usize, &mut [f32]) + Sync) -> Vec<u8> {
        if let Some(mosaic) = self.mosaic {
            return self.developed(mosaic, size, crop, seed, seen);
        }
        let (width, height) = size;
        let values = width * 3;
        let tail = (0.5 * self.blur_px * self.blur_px).min(0.25);
        let film = Film::of(self, size.0, crop, seed);
        let mut picture = vec![0_u8; values * height];
        in_bands(values, &mut picture, |first, band| {
            let (mut lens, mut developed) = (Window::over(width, height), Window::over(width, height));
            let (mut blurred, mut soft) = (vec![0.0_f32; values], vec![0.0_f32; values]);
            for (row, stored) in (first..).zip(band.chunks_exact_mut(values)) {
                developed.move_to(row, |row, out| {
                    lens.move_to(row, &seen);
                    lens.convolved(row, tail, &mut blurred);
                    film.develop(&blurred, row, out);
                });
                // The neighbours' weights of a small Gaussian: what sharpening takes for the blurred picture.
                developed.convolved(row, 0.25, &mut soft);
                for (soft, own) in soft.iter_mut().zip(developed.row(row)) {
                    let value = own + self.sharpening * (own - *soft);
                    *soft = value.clamp(0.0, 1.0) * 255.0 + 0.5;
                }
                let ([reds, greens, blues], stored) = (channels(&soft), stored.chunks_exact_mut(3));
                for (stored, ((red, green), blue)) in stored.zip(reds.iter().zip(greens).zip(blues)) {
                    stored.copy_from_slice(&[*red as u8, *green as u8, *blue as u8]);
                }
            }
        });
        picture
    }

    /// Tones that the picture will have, to find edges in: before noise and white balance.
    fn tones(&self, light: &Light<'_>) -> Tones {
        let scale = self.electrons_per_light / self.full_electrons;
        Tones::of(light.width, light.height, |row, line| {
            for (tone, [red, green, blue]) in line.iter_mut().zip(light.pixels(row)) {
                // The square root stands in for the tone curve. Each colour is full by itself: a lamp that shines red
                // before white paint is an edge, though either is brighter than white.
                let [red, green, blue] = [red, green, blue].map(|it| edges::less(scale * it, 1.0));
                *tone = (0.2126 * red + 0.7152 * green + 0.0722 * blue).max(0.0).sqrt();
            }
        })
    }
}

/// The reds, greens and blues of a row.
fn channels(row: &[f32]) -> [&[f32]; 3] {
    let (reds, rest) = row.split_at(row.len() / 3);
    let (greens, blues) = rest.split_at(reds.len());
    [reds, greens, blues]
}

/// Likewise, to be filled.
fn channels_mut(row: &mut [f32]) -> [&mut [f32]; 3] {
    let (reds, rest) = row.split_at_mut(row.len() / 3);
    let (greens, blues) = rest.split_at_mut(reds.len());
    [reds, greens, blues]
}

#[cfg(test)]
mod tests;
