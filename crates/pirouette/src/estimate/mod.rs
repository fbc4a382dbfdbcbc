//! Keypoints without a detector: rough silhouettes, and the mannequin that overlaps them best.
//!
//! A static camera sees the background behind a turning person in most photos, so that the color on which most photos
//! agree shows it, unless a photo of the empty room does. What differs from it is a rough silhouette. A mannequin in the
//! stated pose, at the stated turn angles, with rotated arms and spread legs, is searched whose silhouettes overlap the
//! rough ones best; its joints are the estimate. If nothing overlaps well, clothes of one color may hide the background in
//! most photos: then the colors of the background and of the person are learned where most photos agree. Rough silhouettes
//! are no results: the joints seed the segmentation.
//!
//! The estimate has errors of about 2 % of the stature, twice those of a detector. It cannot notice wrong turn angles.

mod figure;
mod palette;
mod rough;
#[cfg(test)]
mod tests;

use pirouette_body::mannequin::MannequinError;
use pirouette_body::{Camera, Keypoints};
use pirouette_geom::Mask;
use pirouette_geom::morphology::dilate;
use pirouette_geom::parallel::prelude::*;
use thiserror::Error;

use crate::scan::{Photo, Scan, View};
use crate::skeleton_fit::{USUAL_VERTICAL_FOV_DEGREES, usual_camera_height_mm};
use figure::{Figure, RoughView, find_figure};
use rough::{
    Background, Blocks, Estimate, Votes, as_exposed, block_side, blocks, common_background,
    rough_silhouette,
};

/// Minimum number of photos whose common color is the background
const MIN_VIEWS: usize = 4;

/// Share of the photo that a person covers at least, and at most
const MIN_COVER: f64 = 0.01;
const MAX_COVER: f64 = 0.6;

/// Share of the photo's border that a person covers at most
const MAX_BORDER: f64 = 0.2;

/// Why keypoints cannot be estimated
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum EstimateError {
    /// The background cannot be determined
    #[error(
        "{count} photos are too few to find the background that they share, at least {MIN_VIEWS} are needed; \
         add a photo of the empty room (background.jpg) or keypoints"
    )]
    TooFewViews {
        /// Number of photos
        count: usize,
    },
    /// Photos of several sizes
    #[error(
        "photos of {width}x{height} px and {other_width}x{other_height} px have no background in common; \
         provide keypoints"
    )]
    Size {
        /// Columns of the first photo
        width: usize,
        /// Its rows
        height: usize,
        /// Columns of another photo
        other_width: usize,
        /// Its rows
        other_height: usize,
    },
    /// The photo of the background has another size
    #[error(
        "the photo of the background has {found_width}x{found_height} px, the others {width}x{height} px; \
         take it with the same camera from the same place, or remove it"
    )]
    BackgroundSize {
        /// Columns of the photo of the background
        found_width: usize,
        /// Its rows
        found_height: usize,
        /// Columns of the other photos
        width: usize,
        /// Their rows
        height: usize,
    },
    /// Some photos show no person before the background
    #[error(
        "no person differs from the background in {count} of {total} photos ({first}): the camera moved, or the person has \
         the colors of the background; provide keypoints"
    )]
    NoPerson {
        /// Number of photos without
        count: usize,
        /// Number of all photos
        total: usize,
        /// Name of the first view without
        first: String,
    },
    /// No mannequin of that stature
    #[error("no figure of the person's height")]
    Mannequin(#[from] MannequinError),
}

/// Estimates the keypoints of all views, in px of their photos
///
/// `background` shows the room without the person, from the same place; without it, the background is what most photos
/// have in common. Given masks replace rough silhouettes. After `cancelled` returns true, the result is incomplete.
///
/// # Errors
/// When the background cannot be determined, or hardly anything differs from it.
///
/// # Source
/// Zwettler et al. 2021, refinement of a posed figure by the overlap with the silhouette; here on rough silhouettes, with
/// one posture for all views.
pub fn estimate_keypoints(
    scan: &Scan,
    background: Option<&Photo>,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<Keypoints>, EstimateError> {
    let photos: Vec<&Photo> = scan.views.iter().map(|view| &view.photo).collect();
    let Some(&first) = photos.first() else {
        return Ok(Vec::new());
    };
    let (width, height) = (first.width(), first.height());
    let other_size = |photo: &&Photo| !photo.same_size(first);
    if let Some(other) = photos.iter().copied().find(other_size) {
        return Err(EstimateError::Size {
            width,
            height,
            other_width: other.width(),
            other_height: other.height(),
        });
    }
    if let Some(found) = background.filter(other_size) {
        return Err(EstimateError::BackgroundSize {
            found_width: found.width(),
            found_height: found.height(),
            width,
            height,
        });
    }
    if background.is_none()
        && photos.len() < MIN_VIEWS
        && scan.views.iter().any(|v| v.mask.is_none())
    {
        return Err(EstimateError::TooFewViews {
            count: photos.len(),
        });
    }
    let side = block_side(first);
    let scene = Scene::new(scan, background, side);
    let stature_mm = scan.stature_mm.unwrap_or(USUAL_STATURE_MM);
    let camera = start_camera(scan, first, side, stature_mm);
    let find = |votes: Votes| {
        let mut views = scene.rough_views(None, votes)?;
        let mut figure = find_figure(&views, scan.pose, stature_mm, &camera, cancelled)?;
        for _ in 0..REFINEMENTS {
            views = scene.rough_views(Some(figure.silhouettes(&views)), votes)?;
            figure = figure.refined(&views, cancelled);
        }
        let overlap = figure.overlap(&views);
        Ok::<_, EstimateError>(Found {
            figure,
            views,
            overlap,
        })
    };
    let plain = find(Votes::Plain);
    let is_good = |found: &Found| found.overlap > GOOD_OVERLAP;
    let found = if background.is_some() || plain.as_ref().is_ok_and(is_good) {
        plain?
    } else {
        better(plain, find(Votes::ByPalette))?
    };
    let Found { figure, views, .. } = found;
    let joints = figure.joints(&views);
    Ok(joints
        .iter()
        .map(|joints| scaled(joints, side as f64))
        .collect())
}

/// Repetitions with a background that the figure does not hide
const REFINEMENTS: usize = 1;

/// A figure with the rough silhouettes that it overlaps
struct Found {
    figure: Figure,
    views: Vec<RoughView>,
    /// Intersection over union of both
    overlap: f64,
}

/// Returns the figure with the larger overlap
fn better(
    first: Result<Found, EstimateError>,
    second: Result<Found, EstimateError>,
) -> Result<Found, EstimateError> {
    match (first, second) {
        (Ok(first), Ok(second)) if first.overlap >= second.overlap => Ok(first),
        (_, Ok(second)) => Ok(second),
        (first, Err(_)) => first,
    }
}

/// Overlap from which rough silhouettes are those of a person
///
/// People in front of furnished rooms reach 0.78 to 0.87; 0.43 if the color of the clothes was taken for the background.
const GOOD_OVERLAP: f64 = 0.65;

/// Usual and largest error of the figure's outline, relative to its height
const USUAL_ERROR: f64 = 0.03;
const LARGEST_ERROR: f64 = 0.08;

/// Stature of the figure if unknown: the joints in the photos hardly depend on it
const USUAL_STATURE_MM: f64 = 1700.0;

/// The photos of a scan in blocks
struct Scene<'a> {
    scan: &'a Scan,
    colors: Vec<Blocks>,
    /// Given silhouettes
    given: Vec<Option<Mask>>,
    /// A given photo of the background
    background: Option<Background>,
}

impl<'a> Scene<'a> {
    fn new(scan: &'a Scan, background: Option<&Photo>, side: usize) -> Self {
        let views = &scan.views;
        let given = |view: &View| view.mask.as_ref().map(|mask| shrunk(mask, side));
        Self {
            scan,
            colors: views
                .par_iter()
                .map(|view| blocks(&view.photo, side))
                .collect(),
            given: views.iter().map(given).collect(),
            background: background.map(|photo| blocks(photo, side).map(|&color| Some(color))),
        }
    }

    /// Returns the rough silhouettes, with the silhouettes of figures that they resemble
    fn rough_views(
        &self,
        figures: Option<Vec<Mask>>,
        votes: Votes,
    ) -> Result<Vec<RoughView>, EstimateError> {
        let estimate = |inside: Mask| {
            let bounds = inside.bounding_box();
            let height = bounds.map_or(0.0, |(_, top, _, bottom)| (bottom - top) as f64);
            Estimate {
                hidden: dilate(&inside, USUAL_ERROR * height),
                near: dilate(&inside, LARGEST_ERROR * height),
                inside,
            }
        };
        let estimate = |masks: Vec<Mask>| masks.into_par_iter().map(estimate).collect();
        let figures: Option<Vec<Estimate>> = figures.map(estimate);
        let common = match &self.background {
            Some(_) => None,
            None => common_background(&self.colors, figures.as_deref(), votes),
        };
        let background = self.background.as_ref().or(common.as_ref());
        let views = self.scan.views.par_iter().enumerate().map(|(index, view)| {
            let colors = &self.colors[index];
            let figure = figures.as_ref().map(|figures| &figures[index]);
            let mask = match (&self.given[index], background) {
                (Some(mask), _) => mask.clone(),
                (None, Some(background)) if self.background.is_some() => {
                    let background = as_exposed(background, colors);
                    rough_silhouette(colors, &background, figure)
                }
                (None, Some(background)) => rough_silhouette(colors, background, figure),
                (None, None) => Mask::filled(colors.width(), colors.height(), false),
            };
            RoughView {
                turn: view.turn,
                area: mask.area(),
                mask,
            }
        });
        let views: Vec<RoughView> = views.collect();
        let named = self.scan.views.iter().zip(&views);
        let mut without = named.filter(|(_, rough)| !is_person(&rough.mask));
        match without.next() {
            Some((first, _)) => Err(EstimateError::NoPerson {
                count: 1 + without.count(),
                total: views.len(),
                first: first.name.clone(),
            }),
            None => Ok(views),
        }
    }
}

/// Returns whether a silhouette has a plausible size, and a plausible part of the border
fn is_person(mask: &Mask) -> bool {
    let (width, height) = (mask.width(), mask.height());
    let share = mask.area() as f64 / (width * height).max(1) as f64;
    let is_border = |x: usize, y: usize| x == 0 || y == 0 || x + 1 == width || y + 1 == height;
    let at_border = Mask::from_fn(width, height, |x, y| is_border(x, y) && mask[(x, y)]);
    let border = at_border.area() as f64 / (2 * (width + height)).max(1) as f64;
    (MIN_COVER..MAX_COVER).contains(&share) && border < MAX_BORDER
}

/// Returns the value at the middle of each block
fn shrunk(mask: &Mask, side: usize) -> Mask {
    let (width, height) = (mask.width() / side, mask.height() / side);
    Mask::from_fn(width, height, |x, y| {
        mask[(x * side + side / 2, y * side + side / 2)]
    })
}

/// Returns the camera as given, or as assumed, for images of blocks; its distance follows from the silhouettes
fn start_camera(scan: &Scan, photo: &Photo, side: usize, stature_mm: f64) -> Camera {
    let setup = &scan.camera;
    Camera {
        width_px: photo.width() / side,
        height_px: photo.height() / side,
        vertical_fov_radians: setup
            .vertical_fov_radians
            .unwrap_or(USUAL_VERTICAL_FOV_DEGREES.to_radians()),
        height_mm: setup
            .height_mm
            .unwrap_or(usual_camera_height_mm(stature_mm)),
        distance_mm: 2.0 * stature_mm,
        pitch_radians: setup.pitch_radians.unwrap_or(0.0),
        yaw_radians: setup.yaw_radians.unwrap_or(0.0),
        distortion: setup.distortion,
    }
}

/// Returns keypoints in px of the photo, from those in blocks
fn scaled(keypoints: &Keypoints, side: f64) -> Keypoints {
    let joints = keypoints.iter();
    let scaled = joints.map(|(joint, mut keypoint)| {
        keypoint.position *= side;
        (joint, keypoint)
    });
    scaled.collect()
}
