//! Heights of the landmarks: where the person's differ from the avatar's, as far as the silhouettes show.

use glam::DVec3;
use pirouette_geom::TriMesh;

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
pub(super) fn find(body: &TriMesh, avatar: &Avatar, views: &[SeenView]) -> Levels {
    let avatar_crotch = avatar.landmark(Landmark::Crotch).map(|p| p.y);
    let of_tape = |girth| expected_tape(avatar, girth).map(|tape| tape.center().y);
    let carried =
        |level: Option<f64>| Measured::of(level.ok_or(Unavailable::NoLandmark), Method::Avatar);
    let bust = of_tape(Girth::Bust);
    let waist = of_tape(Girth::Waist);
    let crotch = avatar_crotch.and_then(|expected| part_of_legs(expected, views));
    let hip = of_tape(Girth::Hip);
    let seat = match (hip, avatar_crotch, waist) {
        (Some(hip), Some(crotch), Some(waist)) => rearmost(body, hip, crotch, waist),
        _ => None,
    };
    let measured = |found: Option<f64>, expected: Option<f64>| match found {
        Some(level) => Measured::of(Ok(level), Method::Silhouettes),
        None => carried(expected),
    };
    Levels {
        crotch: measured(crotch, avatar_crotch),
        bust: carried(bust),
        waist: carried(waist),
        hip: measured(seat, hip),
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

/// Height of the rearmost point of the seat
fn rearmost(body: &TriMesh, hip: f64, crotch: f64, waist: f64) -> Option<f64> {
    /// The seat is flat at its end: all that comes this near to the rearmost point counts, in mm
    const DEPTH_MM: f64 = 2.0;
    /// Hands hang beside the seat: only the middle of the body counts, as a part of the crotch's height
    const HALF_WIDTH: f64 = 0.2;
    let lowest = crotch.max(hip - 80.0);
    let highest = (hip + 80.0).min((hip + waist) / 2.0 + 20.0);
    let seat = || {
        body.positions
            .iter()
            .filter(move |p| (lowest..highest).contains(&p.y) && p.x.abs() < HALF_WIDTH * crotch)
    };
    let rear = seat().map(|p| p.z).min_by(f64::total_cmp)?;
    let near: Vec<f64> = seat()
        .filter(|p| p.z < rear + DEPTH_MM)
        .map(|p| p.y)
        .collect();
    Some(near.iter().sum::<f64>() / near.len() as f64)
}
