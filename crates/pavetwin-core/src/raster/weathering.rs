//! The map of weathering from its fields, in one pass over them.

/// A field of the ground beside the kerb, and how much more it is on the carriageway.
#[derive(Debug, Clone, Copy)]
pub struct Beside<'a> {
    pub land: &'a [f32],
    pub more: &'a [f32],
}

impl Beside<'_> {
    fn at(&self, at: usize, on_road: f32) -> f32 {
        self.land[at] + self.more[at] * on_road
    }
}

/// Fields of one length, a value a cell.
#[derive(Debug, Clone, Copy)]
pub struct Weathering<'a> {
    /// Share of carriageway.
    pub on_road: &'a [f32],
    /// Factors on the reflectance beside the carriageway, on it, and of repairs.
    pub land_tone: &'a [f32],
    pub road_tone: &'a [f32],
    pub repaired: &'a [f32],
    pub stain: Beside<'a>,
    pub spilled: &'a [f32],
    pub dust: Beside<'a>,
    /// How often wheels pass on the carriageway.
    pub wheels: &'a [f32],
}

const TONE: (f32, f32) = (0.2, 1.98);
const MOST_STAIN: f32 = 0.95;

/// Tone, stain, dust and polish of every cell, as bytes: × 128, 255, 255 and 230.
pub fn weathered(fields: &Weathering<'_>) -> Vec<u8> {
    let mut layers = vec![0; 4 * fields.on_road.len()];
    for (at, layer) in layers.as_chunks_mut::<4>().0.iter_mut().enumerate() {
        let on_road = fields.on_road[at];
        let land = fields.land_tone[at];
        let tone = land + (fields.road_tone[at] * fields.repaired[at] - land) * on_road;
        let stain = (fields.stain.at(at, on_road) + fields.spilled[at]).clamp(0.0, MOST_STAIN);
        let dust = fields.dust.at(at, on_road).clamp(0.0, 1.0);
        let polish = fields.wheels[at] * on_road;
        let values = [tone.clamp(TONE.0, TONE.1) * 128.0, stain * 255.0, dust * 255.0, polish * 230.0];
        *layer = values.map(|value| (value + 0.5) as u8);
    }
    layers
}

/// The values of a table of so many columns at some of its rows and columns, row by row.
pub fn looked_up(table: &[f32], table_columns: usize, rows: &[u32], columns: &[u32]) -> Vec<f32> {
    let mut found = Vec::with_capacity(rows.len() * columns.len());
    for row in rows.iter().map(|&row| row as usize) {
        let line = &table[row * table_columns..(row + 1) * table_columns];
        found.extend(columns.iter().map(|&column| line[column as usize]));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn land_and_road_are_joined_by_their_shares() {
        let fields = Weathering {
            on_road: &[0.0, 1.0, 0.5],
            land_tone: &[0.5; 3],
            road_tone: &[1.0; 3],
            repaired: &[0.8; 3],
            stain: Beside { land: &[0.2; 3], more: &[0.4; 3] },
            spilled: &[0.0, 1.0, 0.0],
            dust: Beside { land: &[0.4; 3], more: &[-0.5; 3] },
            wheels: &[1.0; 3],
        };
        assert_eq!(weathered(&fields), [64, 51, 102, 0, 102, 242, 0, 230, 83, 102, 38, 115]);
    }

    #[test]
    fn tables_are_looked_up_row_by_row() {
        let table = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
        assert_eq!(looked_up(&table, 3, &[1, 0], &[2, 2, 0]), [5.0, 5.0, 3.0, 2.0, 2.0, 0.0]);
    }
}
