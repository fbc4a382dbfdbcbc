//! Colors of the background and of the person, learned where most photos agree on the background.

use super::rough::{Blocks, OTHER_COLOR, distance, votes};

/// Share of the views that agree on the background of a pixel
const AGREEMENT: f64 = 0.7;

/// Side of the cells of a palette, in levels, and their number per channel
const CELL: f32 = 12.0;
const CELLS: usize = 32;

/// How often each color is background, and how often it is the person, at pixels where most views agree
pub(super) struct Palette {
    /// For each cell of colors, the number of pixels of background and person
    counts: Vec<[u32; 2]>,
    totals: [u32; 2],
}

impl Palette {
    /// Counts the colors of views; a quarter of the pixels suffices
    pub(super) fn new(views: &[&Blocks]) -> Self {
        let mut counts = vec![[0; 2]; CELLS.pow(3)];
        let mut colors: Vec<[f32; 3]> = Vec::with_capacity(views.len());
        let (width, height) = views
            .first()
            .map_or((0, 0), |view| (view.width(), view.height()));
        for y in (0..height).step_by(2) {
            for x in (0..width).step_by(2) {
                colors.clear();
                colors.extend(views.iter().map(|view| view[(x, y)]));
                let most = colors.iter().map(|&color| (votes(&colors, color), color));
                let Some((count, common)) = most.max_by_key(|(count, _)| *count) else {
                    continue;
                };
                if (count as f64) < AGREEMENT * colors.len() as f64 {
                    continue;
                }
                for &color in &colors {
                    let is_person = distance(color, common) > OTHER_COLOR;
                    counts[cell(color)][usize::from(is_person)] += 1;
                }
            }
        }
        let totals = counts
            .iter()
            .fold([0; 2], |sum, count| [sum[0] + count[0], sum[1] + count[1]]);
        Self { counts, totals }
    }

    /// Returns how typical a color is of the background rather than of the person, from 0 to 1
    pub(super) fn background_share(&self, color: [f32; 3]) -> f32 {
        let counts = self.counts[cell(color)];
        let density = |of: usize| (counts[of] as f32 + 1.0) / (self.totals[of] as f32 + 1.0);
        density(0) / (density(0) + density(1))
    }
}

/// Returns the index of the cell of a color
fn cell(color: [f32; 3]) -> usize {
    let middle = (CELLS / 2) as f32;
    let index = |value: f32| ((value / CELL).floor() + middle).clamp(0.0, (CELLS - 1) as f32);
    color
        .iter()
        .fold(0, |cell, &value| cell * CELLS + index(value) as usize)
}
