//! Seeds and odds from the posed avatar.

use pirouette_geom::distance_map::signed_distance;
use pirouette_geom::{Grid, Mask};
use pirouette_segment::seeds::{LogOdds, Seed};

use super::bones::SeedLines;

/// Reliability of the avatar's outline; lengths in px of a person of 800 px
#[derive(Debug, Clone, Copy)]
pub(super) struct PriorFit {
    /// Pixels farther outside the avatar than this are surely background
    outside_px: f64,
    /// Pixels deeper inside the avatar than this are surely person
    inside_px: f64,
    /// Bones count as person up to this far outside the avatar; negative: only where they run deeper inside it
    bone_px: f64,
    /// Distance outside the avatar at which the odds are even
    even_px: f64,
    /// Distance that changes the log odds by one
    odds_length_px: f64,
    /// Largest contribution of the avatar, as log odds
    max_log_odds: f32,
    /// Whether the detector's log odds are added
    pub(super) uses_person_odds: bool,
}

impl PriorFit {
    /// A scan: the camera is known, clothes are tight, and the clean plate finds what the avatar lacks
    ///
    /// Lines from the neck to nose and ears leave the body under the chin and next to the neck, where the avatar may be
    /// wider than the person: `bone_px` 3 fills these hollows (mean IoU of five rendered scans 0.9858 instead of
    /// 0.9873), -6 begins to lose limbs that the avatar misses.
    pub(super) const SCAN: Self = Self {
        outside_px: 70.0,
        inside_px: 16.0,
        bone_px: -3.0,
        even_px: 0.0,
        odds_length_px: 12.0,
        max_log_odds: 2.5,
        uses_person_odds: false,
    };

    /// One photo of any person: hair, coats, wide trousers and bags that no avatar has
    ///
    /// From 26 street photos. About half of the pixels 5 px outside the avatar are person, and of those more than 8 px
    /// inside it only 1 in 180 is not. Beyond 70 px lie 0.8 % of the person pixels, nearly all of it bags and coats.
    /// Flat for `outside_px` 120 to 180 and `odds_length_px` 8 to 12; a largest contribution of 3 loses bags and coats
    /// again, and so does `even_px` 2 (mean IoU lower by 0.006 each).
    pub(super) const SINGLE: Self = Self {
        outside_px: 150.0,
        inside_px: 8.0,
        bone_px: 3.0,
        even_px: 5.0,
        odds_length_px: 10.0,
        max_log_odds: 2.0,
        uses_person_odds: true,
    };
}

/// Bones that leave the avatar by more than this count as outside
const MISFIT_PX: f64 = 12.0;

/// A larger share of the bones outside the avatar indicates another pose
const MAX_MISFIT_SHARE: f64 = 0.1;

/// Largest contribution of the detector, as log odds
///
/// From 26 street photos: mean IoU 0.928 without the detector's mask, 0.945 with 2 and half of the log odds, 0.954 with 3
/// or 5.
const MAX_DETECTED: f32 = 3.0;

/// Detected log odds below which a pixel under the avatar or a bone may be background: a misplaced joint would make the
/// person behind it part of the silhouette
const CONTRADICTS: f32 = -2.0;

/// Seeds and odds of one view
#[derive(Debug)]
pub(super) struct Prior {
    pub(super) seeds: Grid<Seed>,
    /// `None` is even odds everywhere
    pub(super) odds: Option<Grid<LogOdds>>,
}

impl Prior {
    /// Computes seeds by the distance from the avatar's outline; `None` when no avatar is in view or the bones show
    /// that the person is in another pose
    pub(super) fn new(
        avatar: &Mask,
        lines: &SeedLines,
        scale: f64,
        fit: &PriorFit,
    ) -> Option<Self> {
        let (x0, y0, x1, y1) = avatar.bounding_box()?;
        // Beyond this, every pixel is background at the lowest odds.
        let saturated = f64::from(fit.max_log_odds) * fit.odds_length_px + fit.even_px;
        let farthest = fit.outside_px.max(saturated).max(MISFIT_PX);
        let margin = (farthest.max(0.0) * scale).ceil() as usize + 1;
        let (x0, y0) = (x0.saturating_sub(margin), y0.saturating_sub(margin));
        let width = (x1 + margin).min(avatar.width()) - x0;
        let height = (y1 + margin).min(avatar.height()) - y0;
        let distance = signed_distance(&avatar.crop(x0, y0, width, height));
        let mut seeds = Grid::filled(avatar.width(), avatar.height(), Seed::Background);
        let mut odds = Grid::filled(
            avatar.width(),
            avatar.height(),
            LogOdds::new(-fit.max_log_odds),
        );
        for y in 0..height {
            let row = distance.row(y);
            let seeds = &mut seeds.row_mut(y0 + y)[x0..x0 + width];
            let odds = &mut odds.row_mut(y0 + y)[x0..x0 + width];
            for ((seed, odds), &outside) in seeds.iter_mut().zip(odds).zip(row) {
                let outside = f64::from(outside);
                *seed = if outside > fit.outside_px * scale {
                    Seed::Background
                } else if outside < -fit.inside_px * scale {
                    Seed::Person
                } else if outside < fit.even_px * scale {
                    Seed::ProbablePerson
                } else {
                    Seed::ProbableBackground
                };
                let inside = fit.even_px * scale - outside;
                let log_odds = (inside / (fit.odds_length_px * scale)) as f32;
                *odds = LogOdds::new(log_odds.clamp(-fit.max_log_odds, fit.max_log_odds));
            }
        }
        let (mut met, mut misfits) = (0_usize, 0_usize);
        for line in &lines.lines {
            line.for_each_pixel(
                seeds.width(),
                seeds.height(),
                line.core_radius,
                |x, y, _| {
                    let at = (x as isize - x0 as isize, y as isize - y0 as isize);
                    let outside = distance.get(at.0, at.1).copied().unwrap_or(f32::INFINITY);
                    let outside = f64::from(outside);
                    met += 1;
                    misfits += usize::from(outside > MISFIT_PX * scale);
                    if outside < fit.bone_px * scale {
                        seeds[(x, y)] = Seed::Person;
                    }
                },
            );
        }
        if misfits as f64 > MAX_MISFIT_SHARE * met as f64 {
            return None;
        }
        Some(Self {
            seeds,
            odds: Some(odds),
        })
    }

    /// Takes seeds that no avatar supports.
    pub(super) fn of_seeds(seeds: Grid<Seed>) -> Self {
        Self { seeds, odds: None }
    }

    /// Adds a detector's log odds of each pixel to show the person; seeds that they contradict become undecided.
    pub(super) fn with_detected(self, detected: &Grid<LogOdds>) -> Self {
        let Self { mut seeds, odds } = self;
        let even = || Grid::filled(seeds.width(), seeds.height(), LogOdds::default());
        let mut odds = odds.unwrap_or_else(even);
        let pixels = seeds.as_mut_slice().iter_mut().zip(odds.as_mut_slice());
        for ((seed, odds), detected) in pixels.zip(detected.as_slice()) {
            let detected = detected.value().clamp(-MAX_DETECTED, MAX_DETECTED);
            *odds = LogOdds::new(odds.value() + detected);
            if *seed == Seed::Person && detected < CONTRADICTS {
                *seed = Seed::ProbableBackground;
            }
        }
        Self {
            seeds,
            odds: Some(odds),
        }
    }
}
