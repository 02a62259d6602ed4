//! What a sensor costs: a picture of 640 × 640 with grain and edges, still and in motion.

use criterion::{Criterion, criterion_group, criterion_main};
use pavetwin_core::imaging::{Crop, Light, Motion, Sensor};
use std::collections::HashMap;
use std::hint::black_box;

const SIDE: usize = 640;

/// Pavement of about 1 kcd/m² with grain of ± 12 %, and a bright line every 64 pixels: half floats.
fn pavement() -> Vec<u16> {
    (0..SIDE * SIDE)
        .flat_map(|pixel| {
            let (row, column) = (pixel / SIDE, pixel % SIDE);
            let grain = (pixel as u32).wrapping_mul(2_654_435_761) >> 24;
            let half = if (column + row / 8) % 64 < 4 { 0x4400 } else { 0x3b00 + grain as u16 };
            [half, half, half - 20, 0x3c00]
        })
        .collect()
}

fn sensor() -> Sensor {
    Sensor {
        electrons_per_light: 2500.0,
        full_electrons: 15_000.0,
        read_electrons: 2.5,
        vignetting: 0.14,
        blur_px: 0.45,
        white_balance: [1.1, 1.0, 1.2],
        saturation: 1.1,
        sharpening: 0.5,
        curve: (0..1024).map(|step| step as f32 / 1023.0).collect(),
        mosaic: None,
    }
}

fn exposing(criterion: &mut Criterion) {
    let (halves, sensor) = (pavement(), sensor());
    let crop = Crop::whole((SIDE, SIDE));
    let light = Light { width: SIDE, height: SIDE, halves: &halves };
    criterion.bench_function("still", |bencher| bencher.iter(|| sensor.expose(black_box(&light), crop, None, 7)));
    let depth = vec![10.0_f32; SIDE * SIDE];
    let motion =
        Motion { depth: &depth, labels: &[], focal: SIDE as f32, still: [0.0, 0.0125, 0.0], moving: HashMap::new() };
    criterion
        .bench_function("moving", |bencher| bencher.iter(|| sensor.expose(black_box(&light), crop, Some(&motion), 7)));
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20);
    targets = exposing
}
criterion_main!(benches);
