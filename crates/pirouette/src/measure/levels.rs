//! Heights of the landmarks: where the person's differ from the avatar's, as far as the silhouettes show.

use glam::DVec3;

use super::support::{ExpectedTape, SeenView};
use super::{Girth, Landmark, Measured, Method, Unavailable, expected_tape};
use crate::avatar::Avatar;

/// Heights above the floor
#[derive(Debug)]
pub(super) struct Levels {
    pub(super) crotch: Measured,
    pub(super) bust: Measured,
    pub(super) waist: Measured,
    pub(super) hip: Measured,
    /// How much higher the crotch is than the avatar's, in mm
    crotch_rise_mm: f64,
}

/// Finds the heights
pub(super) fn find(avatar: &Avatar, views: &[SeenView]) -> Levels {
    let avatar_crotch = avatar.landmark(Landmark::Crotch).map(|p| p.y);
    let of_tape = |girth| expected_tape(avatar, girth).map(|tape| tape.center().y);
    let carried =
        |level: Option<f64>| Measured::of(level.ok_or(Unavailable::NoLandmark), Method::Avatar);
    let bust = of_tape(Girth::Bust);
    let waist = of_tape(Girth::Waist);
    let crotch = avatar_crotch.and_then(|expected| part_of_legs(expected, views));
    let hip = of_tape(Girth::Hip);
    let measured = |found: Option<f64>, expected: Option<f64>| match found {
        Some(level) => Measured::of(Ok(level), Method::Silhouettes),
        None => carried(expected),
    };
    Levels {
        crotch: measured(crotch, avatar_crotch),
        bust: carried(bust),
        waist: carried(waist),
        hip: carried(hip),
        crotch_rise_mm: match (crotch, avatar_crotch) {
            (Some(found), Some(expected)) => found - expected,
            _ => 0.0,
        },
    }
}

impl Levels {
    /// Moves the avatar's tape to the person's level
    pub(super) fn place(&self, girth: Girth, tape: ExpectedTape) -> ExpectedTape {
        let level = match girth {
            Girth::Bust => self.bust.value_mm.ok(),
            Girth::Waist => self.waist.value_mm.ok(),
            Girth::Hip => self.hip.value_mm.ok(),
            // The thigh is taken right below the crotch.
            Girth::LeftThigh | Girth::RightThigh => Some(tape.center().y + self.crotch_rise_mm),
            _ => None,
        };
        match level {
            Some(level) => tape.moved(DVec3::Y * (level - tape.center().y)),
            None => tape,
        }
    }
}

/// How far from the avatar's the crotch is looked for, in mm
const CROTCH_SEARCH_MM: f64 = 60.0;

/// The height at which the legs part, by the views in which the avatar's do so at nearly the same height
///
/// `None` when no view shows a gap near there: thighs that touch hide it.
fn part_of_legs(expected: f64, views: &[SeenView]) -> Option<f64> {
    let mut heights: Vec<f64> = views
        .iter()
        .filter_map(|view| view.top_of_gap(expected, CROTCH_SEARCH_MM))
        .collect();
    heights.sort_by(f64::total_cmp);
    // The views from front and back show it best; a view from aside shows a lower gap.
    heights.last().copied()
}
