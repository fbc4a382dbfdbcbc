//! Costs of separating neighboring pixels, computed by rows.

use std::ops::Range;

use pirouette_geom::Grid;

use crate::clean_plate::{CleanPlate, squared_distance};
use crate::log_domain::exp_of_negative;
use crate::seeds::{Seed, Window};

/// Squared difference of neighbors in the clean plate, in squared levels, that halves the contrast of a pair
const ATTENUATION_STEP: f32 = 25.0;

/// Squared distance to the clean plate, in squared levels, at which attenuation has decreased to 1/e: pairs that
/// differ from the plate belong to the person or to its outline
const ATTENUATION_REACH: f32 = 200.0;

/// Parameters of the cost of separating neighbors
#[derive(Debug, Clone, Copy)]
pub struct Contrast<'a> {
    /// Cost of separating two neighbors of equal color
    pub smoothness: f32,
    /// Reciprocal of the squared contrast, in squared levels, that reduces the cost to 1/e; see [`contrast_scale`]
    pub beta: f32,
    /// Attenuates contrast that the background also has
    pub clean_plate: Option<&'a CleanPlate>,
}

/// Energies of the links of one row's pixels: right, below, below right and below left
///
/// Each has one value before the first pixel and one after the last, both 0.
#[derive(Debug, Clone)]
pub(crate) struct RowLinks {
    pub(crate) right: Vec<f32>,
    pub(crate) below: Vec<f32>,
    pub(crate) below_right: Vec<f32>,
    pub(crate) below_left: Vec<f32>,
}

impl RowLinks {
    pub(crate) fn new(width: usize) -> Self {
        let none = || vec![0.0; width + 2];
        Self {
            right: none(),
            below: none(),
            below_right: none(),
            below_left: none(),
        }
    }
}

/// Iterates over the links of a window of a photo, row by row from the top
pub(crate) struct LinkRows<'a> {
    photo: &'a Grid<[u8; 3]>,
    window: Window,
    contrast: Contrast<'a>,
    current: RowColors,
    next: RowColors,
    y: usize,
}

impl<'a> LinkRows<'a> {
    pub(crate) fn new(photo: &'a Grid<[u8; 3]>, window: Window, contrast: Contrast<'a>) -> Self {
        let mut next = RowColors::new(window.width);
        next.read_row(photo, contrast.clean_plate, window, 0);
        Self {
            photo,
            window,
            contrast,
            current: RowColors::new(window.width),
            next,
            y: 0,
        }
    }

    /// Computes the links of the next row; pixels of the last row are linked to the right only
    ///
    /// `columns` are the columns of the window whose pixels need links, in this row or from the row below, in ascending
    /// order and disjoint. Other links are unspecified.
    pub(crate) fn read_links(&mut self, columns: &[Range<usize>], links: &mut RowLinks) {
        std::mem::swap(&mut self.current, &mut self.next);
        let (width, last) = (self.window.width, self.window.height - 1);
        let Contrast {
            smoothness,
            beta,
            clean_plate,
        } = self.contrast;
        let diagonal = smoothness / std::f32::consts::SQRT_2;
        if self.y < last {
            self.next
                .read_row(self.photo, clean_plate, self.window, self.y + 1);
        }
        let (current, next) = (&self.current, &self.next);
        for columns in columns {
            // pairs that start one before the first column have their second pixel there
            let (start, end) = (columns.start.saturating_sub(1), columns.end.min(width));
            let (all, fewer) = (1 + start..1 + end, 1 + start..1 + end.min(width - 1));
            current.link(
                start,
                current,
                start + 1,
                smoothness,
                beta,
                &mut links.right[fewer.clone()],
            );
            if self.y < last {
                let left = start.max(1)..(end + 1).min(width);
                current.link(start, next, start, smoothness, beta, &mut links.below[all]);
                current.link(
                    start,
                    next,
                    start + 1,
                    diagonal,
                    beta,
                    &mut links.below_right[fewer],
                );
                current.link(
                    left.start,
                    next,
                    left.start - 1,
                    diagonal,
                    beta,
                    &mut links.below_left[1 + left.start..1 + left.end],
                );
            }
        }
        if self.y == last {
            for below in [
                &mut links.below,
                &mut links.below_right,
                &mut links.below_left,
            ] {
                below.fill(0.0);
            }
        }
        self.y += 1;
    }
}

/// One row of the photo and of the clean plate
struct RowColors {
    photo: [Vec<f32>; 3],
    clean_plate: [Vec<f32>; 3],
    /// 1 where the clean plate has a color
    known: Vec<f32>,
    /// Squared distance of photo and clean plate
    foreign: Vec<f32>,
    attenuating: bool,
}

impl RowColors {
    fn new(width: usize) -> Self {
        let row = || vec![0.0; width];
        Self {
            photo: std::array::from_fn(|_| row()),
            clean_plate: std::array::from_fn(|_| row()),
            known: row(),
            foreign: row(),
            attenuating: false,
        }
    }

    fn read_row(
        &mut self,
        photo: &Grid<[u8; 3]>,
        clean_plate: Option<&CleanPlate>,
        window: Window,
        y: usize,
    ) {
        let row = window.row(photo, y);
        for (channel, values) in self.photo.iter_mut().enumerate() {
            for (value, color) in values.iter_mut().zip(row) {
                *value = f32::from(color[channel]);
            }
        }
        self.attenuating = clean_plate.is_some();
        let Some(clean_plate) = clean_plate else {
            return;
        };
        let (behind, known) = clean_plate.row(window, y);
        for (channel, values) in self.clean_plate.iter_mut().enumerate() {
            for (value, color) in values.iter_mut().zip(behind) {
                *value = f32::from(color[channel]);
            }
        }
        for (value, &count) in self.known.iter_mut().zip(known) {
            *value = f32::from(u8::from(count > 0));
        }
        for ((foreign, color), behind) in self.foreign.iter_mut().zip(row).zip(behind) {
            *foreign = squared_distance(*color, *behind) as f32;
        }
    }

    /// Computes energies between this row from pixel `from` on and another one from `other_from` on
    fn link(
        &self,
        from: usize,
        other: &Self,
        other_from: usize,
        smoothness: f32,
        beta: f32,
        out: &mut [f32],
    ) {
        let count = out.len();
        fn cut(row: &[f32], from: usize, count: usize) -> &[f32] {
            &row[from..from + count]
        }
        let step = |rows: &[Vec<f32>; 3], others: &[Vec<f32>; 3], out: &mut [f32]| {
            let [a, b, c] = rows.each_ref().map(|row| cut(row, from, count));
            let [d, e, f] = others.each_ref().map(|row| cut(row, other_from, count));
            for i in 0..count {
                let (x, y, z) = (a[i] - d[i], b[i] - e[i], c[i] - f[i]);
                out[i] = x * x + y * y + z * z;
            }
        };
        if !self.attenuating {
            step(&self.photo, &other.photo, out);
            for energy in out {
                *energy = smoothness * exp_of_negative(-beta * *energy);
            }
            return;
        }
        step(&self.clean_plate, &other.clean_plate, out);
        let [foreign, known] = [&self.foreign, &self.known].map(|row| cut(row, from, count));
        let [other_foreign, other_known] =
            [&other.foreign, &other.known].map(|row| cut(row, other_from, count));
        let [a, b, c] = self.photo.each_ref().map(|row| cut(row, from, count));
        let [d, e, f] = other
            .photo
            .each_ref()
            .map(|row| cut(row, other_from, count));
        for i in 0..count {
            let (x, y, z) = (a[i] - d[i], b[i] - e[i], c[i] - f[i]);
            let contrast = x * x + y * y + z * z;
            let alike = exp_of_negative(-foreign[i].max(other_foreign[i]) / ATTENUATION_REACH);
            let shown = out[i] / ATTENUATION_STEP * known[i] * other_known[i] * alike;
            out[i] = smoothness * exp_of_negative(-beta * (contrast / (1.0 + shown)));
        }
    }
}

/// Returns the reciprocal of twice the mean squared contrast of neighbors, in the box of the undecided pixels extended
/// by two; 0 for a flat photo and without undecided pixels
///
/// # Source
/// C. Rother, V. Kolmogorov, A. Blake, 2004, GrabCut, equation 5.
pub fn contrast_scale(photo: &Grid<[u8; 3]>, seeds: &Grid<Seed>) -> f32 {
    let Some(window) = Window::around(&seeds.map(|seed| seed.undecided()), 2) else {
        return 0.0;
    };
    let (mut sum, mut count) = (0_u64, 0_u64);
    for y in 0..window.height {
        let row = window.row(photo, y);
        sum += contrast_sum(row, &row[1..]);
        count += row.len() as u64 - 1;
        if y + 1 == window.height {
            continue;
        }
        let below = window.row(photo, y + 1);
        sum += contrast_sum(row, below);
        sum += contrast_sum(row, &below[1..]);
        sum += contrast_sum(&row[1..], below);
        count += 3 * row.len() as u64 - 2;
    }
    if sum == 0 {
        0.0
    } else {
        (count as f64 / (2.0 * sum as f64)) as f32
    }
}

/// Sums the squared distances of the pixels of two rows, up to the shorter length
fn contrast_sum(row: &[[u8; 3]], other: &[[u8; 3]]) -> u64 {
    // the squared distances of this many pixels fit into 32 bits
    const RUN: usize = 16_384;
    let count = row.len().min(other.len());
    let (row, other) = (row[..count].as_flattened(), other[..count].as_flattened());
    row.chunks(3 * RUN)
        .zip(other.chunks(3 * RUN))
        .map(|(a, b)| {
            let squares = a.iter().zip(b).map(|(a, b)| {
                let d = i32::from(*a) - i32::from(*b);
                (d * d) as u32
            });
            u64::from(squares.sum::<u32>())
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use pirouette_geom::Mask;
    use proptest::prelude::*;

    use super::*;

    /// Energy of one pair, directly from the equations
    fn energy(
        photo: &Grid<[u8; 3]>,
        contrast: &Contrast,
        a: (usize, usize),
        b: (usize, usize),
    ) -> f32 {
        let apart = squared_distance(photo[a], photo[b]) as f32;
        let shown = contrast.clean_plate.and_then(|clean_plate| {
            let (behind_a, behind_b) = (clean_plate.color(a.0, a.1)?, clean_plate.color(b.0, b.1)?);
            let foreign = squared_distance(photo[a], behind_a)
                .max(squared_distance(photo[b], behind_b)) as f32;
            let step = squared_distance(behind_a, behind_b) as f32;
            Some(step / ATTENUATION_STEP * (-foreign / ATTENUATION_REACH).exp())
        });
        let distance = (a.0.abs_diff(b.0) as f32).hypot(a.1.abs_diff(b.1) as f32);
        let contrast_left = apart / (1.0 + shown.unwrap_or(0.0));
        contrast.smoothness / distance * (-contrast.beta * contrast_left).exp()
    }

    proptest! {
        #[test]
        fn rows_of_links_match_single_pairs(
            colors in prop::collection::vec(prop::array::uniform3(90_u8..130), 3 * 6 * 5),
            seen in prop::collection::vec(any::<bool>(), 6 * 5),
            with_clean_plate in any::<bool>(),
        ) {
            let [photo, other, third] = [0, 1, 2]
                .map(|i| Grid::from_vec(6, 5, colors[30 * i..30 * (i + 1)].to_vec()));
            let seen = Mask::from_vec(6, 5, seen);
            let clean_plate =
                CleanPlate::estimate(&[(&other, &seen), (&third, &seen)], &Default::default());
            let clean_plate = clean_plate.as_ref().filter(|_| with_clean_plate);
            let contrast = Contrast { smoothness: 40.0, beta: 0.002, clean_plate };
            let window = Window { x0: 1, y0: 1, width: 5, height: 4 };
            let mut rows = LinkRows::new(&photo, window, contrast);
            let mut links = RowLinks::new(window.width);
            for y in 0..window.height {
                rows.read_links(std::slice::from_ref(&(0..window.width)), &mut links);
                for x in 0..window.width {
                    let at = |x, y| (window.x0 + x, window.y0 + y);
                    let pair = |x1: usize, y1: usize| {
                        if x1 < window.width && y1 < window.height {
                            energy(&photo, &contrast, at(x, y), at(x1, y1))
                        } else {
                            0.0
                        }
                    };
                    for (found, expected) in [
                        (links.right[x + 1], pair(x + 1, y)),
                        (links.below[x + 1], pair(x, y + 1)),
                        (links.below_right[x + 1], pair(x + 1, y + 1)),
                        (links.below_left[x + 1], pair(x.wrapping_sub(1), y + 1)),
                    ] {
                        prop_assert!((found - expected).abs() < 1e-3, "{found} {expected}");
                    }
                }
            }
        }
    }
}
