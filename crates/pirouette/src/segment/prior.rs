//! Seeds and odds from the posed avatar.

use pirouette_geom::distance_map::signed_distance;
use pirouette_geom::{Grid, Mask};
use pirouette_segment::seeds::{LogOdds, Seed};

use super::bones::SeedLines;

/// Farther outside the avatar than this is surely background, in px of a person of 800 px
const OUTSIDE_PX: f64 = 70.0;

/// Deeper inside the avatar than this is surely person
const INSIDE_PX: f64 = 16.0;

/// Bones count as person up to this far outside the avatar; farther out the two disagree
const BONE_OUTSIDE_PX: f64 = 3.0;

/// Distance from the avatar's border that changes the log odds by one
const ODDS_LENGTH_PX: f64 = 12.0;

/// Largest say of the avatar, as log odds
const MAX_LOG_ODDS: f32 = 2.5;

/// Bones that leave the avatar by more than this count as outside it
const MISFIT_PX: f64 = 12.0;

/// Larger shares of the bones outside the avatar mean another pose
const MAX_MISFIT_SHARE: f64 = 0.1;

/// Seeds and odds of one view
#[derive(Debug)]
pub(super) struct Prior {
    pub(super) seeds: Grid<Seed>,
    pub(super) odds: Grid<LogOdds>,
}

impl Prior {
    /// Seeds by the distance from the avatar's outline; `None` when there is no avatar in view or the bones
    /// show that the person holds another pose
    pub(super) fn new(coverage: &Grid<f32>, lines: &SeedLines, scale: f64) -> Option<Self> {
        let avatar: Mask = coverage.threshold(0.5);
        avatar.bounding_box()?;
        let distance = signed_distance(&avatar);
        let mut seeds = distance.map(|&outside| {
            let outside = f64::from(outside);
            if outside > OUTSIDE_PX * scale {
                Seed::Background
            } else if outside < -INSIDE_PX * scale {
                Seed::Person
            } else if outside < 0.0 {
                Seed::ProbablePerson
            } else {
                Seed::ProbableBackground
            }
        });
        let (mut met, mut misfits) = (0_usize, 0_usize);
        for line in &lines.lines {
            line.for_each_pixel(
                seeds.width(),
                seeds.height(),
                line.core_radius,
                |x, y, _| {
                    let outside = f64::from(distance[(x, y)]);
                    met += 1;
                    misfits += usize::from(outside > MISFIT_PX * scale);
                    if outside < BONE_OUTSIDE_PX * scale {
                        seeds[(x, y)] = Seed::Person;
                    }
                },
            );
        }
        if misfits as f64 > MAX_MISFIT_SHARE * met as f64 {
            return None;
        }
        let odds = distance.map(|&outside| {
            let steps = -outside / (ODDS_LENGTH_PX * scale) as f32;
            LogOdds::new(steps.clamp(-MAX_LOG_ODDS, MAX_LOG_ODDS))
        });
        Some(Self { seeds, odds })
    }
}
