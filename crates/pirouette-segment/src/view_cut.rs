//! The cut of one view of a scene: what colors say of each pixel, then a graph of what they leave open.

use std::cmp::Ordering;

use pirouette_geom::morphology::dilate;
use pirouette_geom::{Grid, Mask};

use crate::band::BandCut;
use crate::border::clean;
use crate::color_table::ColorTable;
use crate::links::Contrast;
use crate::plate::BackgroundPlate;
use crate::scene_view::SceneView;
use crate::seeds::{Seed, Window};

/// Share of the plate in the density of the background; the rest is for what moved or throws light
const PLATE_SHARE: f32 = 0.95;

/// A pixel is decided without a graph when nothing this near to it is in doubt, in px of a person of 800 px
///
/// 160 rendered photos: 3 and 5 give the same masks as the graph of all pixels.
const DOUBT_REACH_PX: f64 = 3.0;

/// What one view is cut by
pub(crate) struct Evidence<'a> {
    pub(crate) table: &'a ColorTable<'a>,
    pub(crate) plate: Option<&'a BackgroundPlate>,
    /// Largest say of one pixel's color, as log odds
    pub(crate) color_limit: f32,
    /// What the mask is taken to be; `None`: what each pixel's odds say
    pub(crate) mask: Option<&'a Mask>,
    /// Odds that do not support the mask by at least this leave a pixel in doubt
    pub(crate) least_odds: f32,
    pub(crate) contrast: Contrast<'a>,
}

/// Cuts one view; `None` when its seeds decide all pixels
pub(crate) fn cut_view(view: &SceneView, evidence: &Evidence) -> Option<Mask> {
    let undecided = view.seeds.map(|seed| seed.undecided());
    // neighbors of undecided pixels take part in the border
    let window = Window::around(&undecided, 1)?;
    let odds = color_odds(view, window, evidence);
    let seeds = narrow(view, window, &odds, evidence);
    let mut band = BandCut::new(view.photo, &seeds, evidence.contrast);
    let open: Vec<f32> = band
        .pixels()
        .iter()
        .map(|&(x, y)| odds[(x as usize - window.x0, y as usize - window.y0)])
        .collect();
    band.solve(&open);
    Some(clean(&band.mask(&seeds), view.scale))
}

/// How much likelier each undecided pixel of a window is person than background, by its color and by the prior; 0 for
/// decided ones
fn color_odds(view: &SceneView, window: Window, evidence: &Evidence) -> Grid<f32> {
    let mut odds = Grid::filled(window.width, window.height, 0.0_f32);
    let mut background = Vec::new();
    let limit = evidence.color_limit;
    for y in 0..window.height {
        let (seeds, photo) = (window.row(view.seeds, y), window.row(view.photo, y));
        let mut start = 0;
        for stretch in seeds.chunk_by(|a, b| a.undecided() == b.undecided()) {
            let columns = start..start + stretch.len();
            start = columns.end;
            if !stretch[0].undecided() {
                continue;
            }
            let colors = &photo[columns.clone()];
            let odds = &mut odds.row_mut(y)[columns.clone()];
            background.resize(colors.len(), 0.0);
            for ((&color, person), background) in colors.iter().zip(&mut *odds).zip(&mut background)
            {
                [*person, *background] = evidence.table.log_densities(color);
            }
            if let Some(plate) = evidence.plate {
                let at = (window.x0 + columns.start, window.y0 + y);
                plate.mix_into(at, colors, PLATE_SHARE, &mut background);
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

/// Seeds with the undecided pixels decided that are far from the border of the mask and from all doubt
///
/// A graph of all pixels would hardly ever decide otherwise: an area without doubt that changes its side pays the
/// least odds for each pixel, and saves no more than its outline.
fn narrow(view: &SceneView, window: Window, odds: &Grid<f32>, evidence: &Evidence) -> Grid<Seed> {
    let likelier;
    let mask = match evidence.mask {
        Some(mask) => window.crop(mask),
        None => {
            likelier = odds.map(|&odds| odds > 0.0);
            decided_by_seeds(view, window, likelier)
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
                    .partial_cmp(&evidence.least_odds)
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

/// A mask of a window with decided pixels as the seeds have them
fn decided_by_seeds(view: &SceneView, window: Window, mut mask: Mask) -> Mask {
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
