use super::{Crop, Light, Motion, Sensor};
use std::collections::HashMap;

fn sensor() -> Sensor {
    Sensor {
        electrons_per_light: 1000.0,
        full_electrons: 10_000.0,
        read_electrons: 0.0,
        vignetting: 0.0,
        blur_px: 0.0,
        white_balance: [1.0; 3],
        saturation: 1.0,
        sharpening: 0.0,
        curve: (0..256).map(|step| (step as f32 / 255.0).powi(2)).collect(),
        mosaic: None,
    }
}

/// 1.0 as a half float.
const ONE: u16 = 0x3c00;

fn even(width: usize, height: usize, half: u16) -> Vec<u16> {
    vec![half; width * height * 4]
}

#[test]
fn brighter_is_noisier_and_relatively_cleaner() {
    let spread = |half: u16| {
        let halves = even(64, 64, half);
        let picture =
            sensor().expose(&Light { width: 64, height: 64, halves: &halves }, Crop::whole((64, 64)), None, 3);
        let mean = picture.iter().map(|value| f64::from(*value)).sum::<f64>() / picture.len() as f64;
        let variance =
            picture.iter().map(|value| (f64::from(*value) - mean).powi(2)).sum::<f64>() / picture.len() as f64;
        (mean, variance.sqrt())
    };
    let (dim, dim_spread) = spread(ONE);
    let (bright, bright_spread) = spread(ONE + 0x0800); // 4.0
    assert!((bright / dim - 4.0).abs() < 0.05);
    assert!(bright_spread > 1.5 * dim_spread && bright_spread / bright < dim_spread / dim);
}

#[test]
fn a_full_pixel_is_white() {
    let halves = even(8, 8, 0x5400); // 64 kcd/m²: 64,000 electrons
    let picture = sensor().expose(&Light { width: 8, height: 8, halves: &halves }, Crop::whole((8, 8)), None, 0);
    assert!(picture.iter().all(|value| *value == 255));
}

#[test]
fn the_edge_of_a_red_lamp_before_glaring_white_is_smooth() {
    let mut halves = even(64, 64, 0x5400);
    for (pixel, values) in halves.chunks_mut(4).enumerate() {
        let (column, row) = (pixel % 64, pixel / 64);
        if 5 * row < column + 130 {
            values[1..3].fill(ONE);
        }
    }
    let picture = sensor().expose(&Light { width: 64, height: 64, halves: &halves }, Crop::whole((64, 64)), None, 0);
    let greens = picture.chunks(3).map(|pixel| pixel[1]);
    // Of a stair of five pixels about four are neither red nor white.
    assert!(greens.filter(|green| (60..220).contains(green)).count() > 40);
}

#[test]
fn the_seed_alone_decides_the_noise() {
    let halves = even(16, 16, ONE);
    let light = Light { width: 16, height: 16, halves: &halves };
    assert_eq!(
        sensor().expose(&light, Crop::whole((16, 16)), None, 5),
        sensor().expose(&light, Crop::whole((16, 16)), None, 5)
    );
    assert_ne!(
        sensor().expose(&light, Crop::whole((16, 16)), None, 5),
        sensor().expose(&light, Crop::whole((16, 16)), None, 6)
    );
}

#[test]
fn an_edge_is_smeared_over_the_way() {
    let (width, height) = (64, 4);
    let mut halves = even(width, height, 0);
    for pixel in 0..width * height {
        if pixel % width >= 32 {
            halves[pixel * 4..][..3].fill(0x4900); // 10.0
        }
    }
    let depth = vec![10.0; width * height];
    // 1 m at 10 m under a focal length of 100 px: 10 px.
    let motion = Motion { depth: &depth, labels: &[], focal: 100.0, still: [1.0, 0.0, 0.0], moving: HashMap::new() };
    let picture =
        sensor().expose(&Light { width, height, halves: &halves }, Crop::whole((width, height)), Some(&motion), 0);
    let row: Vec<u8> = (0..width).map(|column| picture[column * 3]).collect();
    let between = row.iter().filter(|value| **value > 12 && **value < 243).count();
    assert!((8..=11).contains(&between), "{between} pixels between dark and bright: {row:?}");
}

#[test]
fn what_moves_along_is_sharp() {
    let (width, height) = (32, 2);
    let (depth, labels) = (vec![10.0; width * height], vec![7; width * height]);
    let moving = HashMap::from([(7, [0.0; 3])]);
    let motion = Motion { depth: &depth, labels: &labels, focal: 100.0, still: [1.0, 0.0, 0.0], moving };
    assert_eq!(motion.at(width, Crop::whole((width, height)), 3, 1), (0.0, 0.0));
}

#[test]
fn a_crop_is_the_part_of_the_whole_frame_that_it_is() {
    let (width, height, left, top, side) = (48, 32, 29, 3, 12);
    let mut whole = sensor();
    whole.vignetting = 0.6;
    // So much light that the noise is less than a step of 255.
    (whole.electrons_per_light, whole.full_electrons) = (1e9, 2e9);
    let picture = |size: (usize, usize), crop: Crop| {
        let halves = even(size.0, size.1, ONE);
        whole.expose(&Light { width: size.0, height: size.1, halves: &halves }, crop, None, 0)
    };
    let frame = picture((width, height), Crop::whole((width, height)));
    let crop = picture((side, side), Crop { frame: (width, height), corner: (left, top) });
    for (pixel, value) in crop.chunks(3).enumerate() {
        let same = (top + pixel / side) * width + left + pixel % side;
        assert!(value[0].abs_diff(frame[3 * same]) <= 1, "pixel {pixel}");
    }
    assert!(crop[3 * (side - 1)] + 10 < crop[3 * side * (side - 1)]);
}

#[test]
fn what_comes_nearer_moves_away_from_the_axis_of_the_whole_frame() {
    let (side, depth) = (8, vec![10.0; 64]);
    // 1 m nearer at 10 m: a tenth of the distance from the axis.
    let motion = Motion { depth: &depth, labels: &[], focal: 100.0, still: [0.0, 0.0, -1.0], moving: HashMap::new() };
    let crop = Crop { frame: (208, 108), corner: (200, 50) };
    let (x, y) = motion.at(side, crop, 0, 3);
    assert!((x - 9.65).abs() < 1e-4 && (y + 0.05).abs() < 1e-4, "{x} {y}");
}
