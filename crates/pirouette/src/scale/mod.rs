//! Estimates the scale of a scan without a given stature: from the size of a pixel, or from a card of known size in a
//! photo.
//!
//! Both yield a stature: that of the skeleton that fits the keypoints and has pixels of this size at the turning axis.

mod card;
mod edges;

use thiserror::Error;

use crate::scan::{CameraSetup, Photo, Scan, StatureFrom};
use crate::skeleton_fit::{KeypointView, SkeletonFitError, SkeletonFitOptions, fit_skeleton};
use pirouette_body::Joint;
use pirouette_body::mannequin::{MannequinError, MannequinParameters, mannequin};

pub use card::{CARD_MM, Card, CardError, find_card};

/// Why a scale cannot be determined
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum ScaleError {
    #[error("no skeleton fits the keypoints, so the size of the person in pixels is not known")]
    Bundle(#[from] SkeletonFitError),
    #[error("cannot build a mannequin for comparison")]
    Mannequin(#[from] MannequinError),
    #[error(
        "no ID-1 card (85.60 x 53.98 mm) was found next to the person in any photo: hold or mount it flat toward the camera, \
         well lit, in front of a background of another color; or specify the stature"
    )]
    NoCard,
    #[error(
        "the rectangle in photo {view} stays in its place while the person turns: it belongs to the room, not to the person; \
         hold the card in one photo only, or specify the stature"
    )]
    Still { view: String },
    #[error(
        "photos {first} and {second} show cards of different scales ({first_mm:.3} and {second_mm:.3} mm per px); \
         keep only one of the cards, or specify the stature"
    )]
    CardsDiffer {
        first: String,
        second: String,
        first_mm: f64,
        second_mm: f64,
    },
    #[error(
        "at {mm_per_px:.3} mm per px the person would be {stature_mm:.0} mm tall; check the pixel size"
    )]
    Implausible { mm_per_px: f64, stature_mm: f64 },
}

/// Range of accepted statures, in mm
const STATURES_MM: std::ops::RangeInclusive<f64> = 700.0..=2400.0;

/// Largest relative difference between cards in several photos
const CARD_SPREAD: f64 = 0.03;

/// Sets the stature of a scan by the size of its pixels
///
/// `mm_per_px` refers to the photos as stored in the scan, at the turning axis.
///
/// # Errors
/// When no skeleton fits, or the resulting stature is out of range.
pub fn scale_by_pixels(
    scan: &mut Scan,
    mm_per_px: f64,
    from: StatureFrom,
) -> Result<(), ScaleError> {
    let avatar = mannequin(&MannequinParameters {
        pose: scan.pose,
        ..MannequinParameters::default()
    })?;
    let views: Vec<KeypointView> = scan.views.iter().map(KeypointView::from).collect();
    // Heights of the camera are in true mm, the mannequin's are not.
    let camera = CameraSetup {
        height_mm: None,
        distance_mm: None,
        ..scan.camera
    };
    let (found, _) = fit_skeleton(
        &avatar,
        &views,
        &camera,
        None,
        &SkeletonFitOptions::default(),
    )?;
    let camera = &found.camera;
    let mannequin_mm_per_px = camera.distance_mm / camera.focal_px();
    let stature_mm = found.avatar.stature_mm() * mm_per_px / mannequin_mm_per_px;
    if !STATURES_MM.contains(&stature_mm) {
        return Err(ScaleError::Implausible {
            mm_per_px,
            stature_mm,
        });
    }
    scan.stature_mm = Some(stature_mm);
    scan.stature_from = from;
    Ok(())
}

/// Sets the stature of a scan from a card in one of its photos; returns the view and the card
///
/// # Errors
/// When there is no card or it stays in its place in most photos, when cards are inconsistent, or no skeleton fits.
pub fn scale_by_card(scan: &mut Scan) -> Result<(String, Card), ScaleError> {
    let mut found: Vec<(String, Card)> = Vec::new();
    let mut still = None;
    for (index, view) in scan.views.iter().enumerate() {
        let points: Vec<glam::DVec2> = Joint::ALL
            .iter()
            .filter_map(|&joint| Some(view.keypoints.found(joint)?.position))
            .collect();
        match find_card(&view.photo, &points) {
            Ok(card) if is_still(scan, index, &card) => still = Some(view.name.clone()),
            Ok(card) => found.push((view.name.clone(), card)),
            Err(_) => {}
        }
    }
    found.sort_by(|a, b| b.1.coverage.total_cmp(&a.1.coverage));
    let Some(best) = found.first().cloned() else {
        return Err(still.map_or(ScaleError::NoCard, |view| ScaleError::Still { view }));
    };
    for (name, card) in &found[1..] {
        if (card.mm_per_px / best.1.mm_per_px - 1.0).abs() > CARD_SPREAD {
            return Err(ScaleError::CardsDiffer {
                first: best.0,
                second: name.clone(),
                first_mm: best.1.mm_per_px,
                second_mm: card.mm_per_px,
            });
        }
    }
    scale_by_pixels(scan, best.1.mm_per_px, StatureFrom::Card)?;
    Ok(best)
}

/// Mean difference of the pixels of a card, in gray levels, below which another photo shows the same there
const SAME_LEVELS: f64 = 10.0;

/// Returns whether most other photos show the same at the place of a card: an object of the room
fn is_still(scan: &Scan, index: usize, card: &Card) -> bool {
    let photo = &scan.views[index].photo;
    let others = || {
        let others = scan.views.iter().enumerate();
        others.filter(|&(i, view)| i != index && view.photo.same_size(photo))
    };
    let same = others().filter(|(_, view)| difference_at(photo, &view.photo, card) < SAME_LEVELS);
    let count = others().count();
    count > 0 && 2 * same.count() > count
}

/// Returns the mean difference of two photos of one size in the bounding box of a card, in gray levels
fn difference_at(a: &Photo, b: &Photo, card: &Card) -> f64 {
    let corners = card.corners.iter().copied();
    let (Some(low), Some(high)) = (
        corners.clone().reduce(glam::DVec2::min),
        corners.reduce(glam::DVec2::max),
    ) else {
        return f64::INFINITY;
    };
    let range = |low: f64, high: f64, size: usize| {
        (low.max(0.0) as usize).min(size)..(high.max(0.0) as usize + 1).min(size)
    };
    let (mut sum, mut count) = (0u64, 0u64);
    for y in range(low.y, high.y, a.height()) {
        for x in range(low.x, high.x, a.width()) {
            let channels = a[(x, y)].iter().zip(b[(x, y)]);
            sum += channels
                .map(|(&a, b)| u64::from(a.abs_diff(b)))
                .sum::<u64>();
            count += 3;
        }
    }
    if count > 0 {
        sum as f64 / count as f64
    } else {
        f64::INFINITY
    }
}
