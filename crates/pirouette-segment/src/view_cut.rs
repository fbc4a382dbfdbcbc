//! The cut of one view of a scene: clear pixels are decided by their odds, the others by a graph.

use std::cmp::Ordering;

use pirouette_geom::morphology::dilate;
use pirouette_geom::{Grid, Mask};

use crate::band::BandCut;
use crate::border::clean_mask;
use crate::clean_plate::CleanPlate;
use crate::color_table::ColorTable;
use crate::links::Contrast;
use crate::scene_view::SceneView;
use crate::seeds::{Seed, Window};

/// Weight of the clean plate in the background density; the rest covers moved objects and shadows
const CLEAN_PLATE_SHARE: f32 = 0.95;

/// Pixels farther than this from all doubtful ones are decided without a graph, in px of a person of 800 px
///
/// 160 rendered photos: 3 and 5 give the same masks as the graph of all pixels.
const DOUBT_REACH_PX: f64 = 3.0;

/// Inputs of the cut of one view
pub(crate) struct Evidence<'a> {
    pub(crate) table: &'a ColorTable<'a>,
    pub(crate) clean_plate: Option<&'a CleanPlate>,
    /// Bound of one pixel's color term, as log odds
    pub(crate) color_limit: f32,
    /// Expected mask; `None`: the sign of each pixel's odds
    pub(crate) mask: Option<&'a Mask>,
    /// Pixels whose odds support the mask by less than this are doubtful
    pub(crate) min_odds: f32,
    pub(crate) contrast: Contrast<'a>,
}

/// Cuts one view; `None` when its seeds decide all pixels
pub(crate) fn cut_view(view: &SceneView, evidence: &Evidence) -> Option<Mask> {
    let undecided = view.seeds.map(|seed| seed.undecided());
    // neighbors of undecided pixels are part of the border
    let window = Window::around(&undecided, 1)?;
    let odds = color_odds(view, window, evidence);
    let seeds = decide_clear_pixels(view, window, &odds, evidence);
    let mut band = BandCut::new(view.photo, &seeds, evidence.contrast);
    let open: Vec<f32> = band
        .pixels()
        .iter()
        .map(|&(x, y)| odds[(x as usize - window.x0, y as usize - window.y0)])
        .collect();
    band.solve(&open);
    Some(clean_mask(&band.mask(&seeds), view.scale))
}

/// Computes the log odds of person against background for each undecided pixel of a window, from its color and the
/// prior; 0 for decided pixels
fn color_odds(view: &SceneView, window: Window, evidence: &Evidence) -> Grid<f32> {
    let mut odds = Grid::filled(window.width, window.height, 0.0_f32);
    let mut background = Vec::new();
    let limit = evidence.color_limit;
    for y in 0..window.height {
        let (seeds, photo) = (window.row(view.seeds, y), window.row(view.photo, y));
        let mut start = 0;
        for run in seeds.chunk_by(|a, b| a.undecided() == b.undecided()) {
            let columns = start..start + run.len();
            start = columns.end;
            if !run[0].undecided() {
                continue;
            }
            let colors = &photo[columns.clone()];
            let odds = &mut odds.row_mut(y)[columns.clone()];
            background.resize(colors.len(), 0.0);
            for ((&color, person), background) in colors.iter().zip(&mut *odds).zip(&mut background)
            {
                [*person, *background] = evidence.table.log_densities(color);
            }
            if let Some(clean_plate) = evidence.clean_plate {
                let at = (window.x0 + columns.start, window.y0 + y);
                clean_plate.mix_into(at, colors, CLEAN_PLATE_SHARE, &mut background);
            }
            for (odds, background) in odds.iter_mut().zip(&background) {
                *odds = (*odds - background).clamp(-limit, limit);
            }
            if let Some(prior) = view.prior {
                let prior = &window.row(prior, y)[columns];
                for (odds, prior) in odds.iter_mut().zip(prior) {
                    *odds += prior.value();
                }
            }
        }
    }
    odds
}

/// Decides the undecided pixels that are far from the border of the mask and from all doubtful pixels
///
/// A graph of all pixels would almost never decide differently: to relabel an area without doubtful pixels costs at
/// least the minimum odds per pixel, and saves at most its outline.
fn decide_clear_pixels(
    view: &SceneView,
    window: Window,
    odds: &Grid<f32>,
    evidence: &Evidence,
) -> Grid<Seed> {
    let likelier;
    let mask = match evidence.mask {
        Some(mask) => window.crop(mask),
        None => {
            likelier = odds.map(|&odds| odds > 0.0);
            apply_seeds(view, window, likelier)
        }
    };
    let mut doubt = Mask::filled(window.width, window.height, false);
    for y in 0..window.height {
        let row = mask.row(y);
        let below = mask.row((y + 1).min(window.height - 1));
        let right = row[1..].iter().chain(row.last());
        for ((((doubt, &person), (below, right)), &odds), seed) in doubt
            .row_mut(y)
            .iter_mut()
            .zip(row)
            .zip(below.iter().zip(right))
            .zip(odds.row(y))
            .zip(window.row(view.seeds, y))
        {
            let support = if person { odds } else { -odds };
            let unsure = seed.undecided()
                && support
                    .partial_cmp(&evidence.min_odds)
                    .is_none_or(Ordering::is_lt);
            *doubt = unsure || person != *below || person != *right;
        }
    }
    let near = dilate(&doubt, (DOUBT_REACH_PX * view.scale).max(2.0));
    let mut seeds = view.seeds.clone();
    for y in 0..window.height {
        let (near, mask) = (near.row(y), mask.row(y));
        for ((seed, &near), &person) in window.row_mut(&mut seeds, y).iter_mut().zip(near).zip(mask)
        {
            if seed.undecided() && !near {
                *seed = if person {
                    Seed::Person
                } else {
                    Seed::Background
                };
            }
        }
    }
    seeds
}

/// Sets the decided pixels of a window's mask to the labels of their seeds
fn apply_seeds(view: &SceneView, window: Window, mut mask: Mask) -> Mask {
    for y in 0..window.height {
        for (person, seed) in mask.row_mut(y).iter_mut().zip(window.row(view.seeds, y)) {
            *person = match seed {
                Seed::Person => true,
                Seed::Background => false,
                _ => *person,
            };
        }
    }
    mask
}
