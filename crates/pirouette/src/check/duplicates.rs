//! Photos that are contained several times.

use pirouette_geom::parallel::prelude::*;

use super::joint_box;
use crate::scan::{Photo, View};

/// Columns and rows of the cells that two photos are compared by
const CELLS: (usize, usize) = (48, 64);

/// Mean difference of the cells of a person, in gray levels, below which two photos show the same moment
///
/// Photos of one moment that were compressed differently differ by 0.2 to 0.8 levels; a person who turned by 5 degrees
/// differs by 3 and more.
const SAME: f64 = 1.2;

/// Angles that differ by less are the same, in degrees: a photo may be given twice at one angle
const SAME_ANGLE_DEGREES: f64 = 2.0;

/// Finds views that repeat the photo of an earlier view at another or an unknown angle; pairs of the view and the earlier one
pub(super) fn find_repeats(views: &[View]) -> Vec<(usize, usize)> {
    let cells: Vec<Vec<f64>> = views.par_iter().map(person_cells).collect();
    let mut repeats: Vec<(usize, usize)> = Vec::new();
    for index in 1..views.len() {
        let is_repeat = |&first: &usize| {
            let turn = views[index].turn.radians() - views[first].turn.radians();
            let turn = turn.sin().atan2(turn.cos()).abs().to_degrees();
            let unknown = |index: usize| !views[index].turn_is_stated();
            let other_angle = unknown(index) || unknown(first) || turn > SAME_ANGLE_DEGREES;
            let repeated = repeats.iter().any(|&(repeat, _)| repeat == first);
            !repeated && other_angle && alike(&cells[index], &cells[first])
        };
        if let Some(first) = (0..index).find(is_repeat) {
            repeats.push((index, first));
        }
    }
    repeats
}

fn alike(a: &[f64], b: &[f64]) -> bool {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
    !a.is_empty() && a.len() == b.len() && sum / (a.len() as f64) < SAME
}

/// Returns the mean gray levels of a grid of cells over the person, or over the photo without joints
fn person_cells(view: &View) -> Vec<f64> {
    let photo = &view.photo;
    let (width, height) = (photo.width() as f64, photo.height() as f64);
    let whole = (glam::DVec2::ZERO, glam::DVec2::new(width, height));
    let (low, high) = joint_box(&view.keypoints).unwrap_or(whole);
    let low = low.clamp(whole.0, whole.1);
    let high = high.clamp(whole.0, whole.1);
    let size = high - low;
    let edge = |start: f64, size: f64, count: usize, i: usize, limit: usize| {
        ((start + size * i as f64 / count as f64) as usize).min(limit)
    };
    let mut cells = Vec::with_capacity(CELLS.0 * CELLS.1);
    for row in 0..CELLS.1 {
        for column in 0..CELLS.0 {
            let x = |i| edge(low.x, size.x, CELLS.0, i, photo.width());
            let y = |i| edge(low.y, size.y, CELLS.1, i, photo.height());
            cells.push(mean_gray(
                photo,
                [x(column), x(column + 1)],
                [y(row), y(row + 1)],
            ));
        }
    }
    cells
}

fn mean_gray(photo: &Photo, [x0, x1]: [usize; 2], [y0, y1]: [usize; 2]) -> f64 {
    let (mut sum, mut count) = (0u64, 0u64);
    for y in y0..y1 {
        for x in x0..x1 {
            sum += photo[(x, y)].iter().map(|&v| u64::from(v)).sum::<u64>();
            count += 3;
        }
    }
    if count > 0 {
        sum as f64 / count as f64
    } else {
        0.0
    }
}
