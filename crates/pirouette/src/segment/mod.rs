//! Stage 1: from photos and the posed avatar to silhouettes.
//!
//! The bones of the skeleton locate the person; where the avatar was posed like the person, its outline is more
//! accurate. Several photos of one person in front of one background support each other: shared color models and a
//! clean plate. A view whose pose differs from the avatar falls back to its bones, and a failed view does not affect
//! the others.

mod bones;
mod prior;
#[cfg(test)]
mod tests;

use pirouette_geom::parallel::prelude::*;
use pirouette_geom::{Grid, Mask, Windowed};
use pirouette_segment::border::{clean_mask, clean_soft_mask, soft_border};
use pirouette_segment::clean_plate::CleanPlateOptions;
use pirouette_segment::grabcut::{GrabCutError, GrabCutOptions, grabcut};
use pirouette_segment::scene::{SceneOptions, SceneView, segment_scene};
use pirouette_segment::seeds::{LogOdds, Seed};

use crate::scan::{Background, Photo};
use bones::SeedLines;
use pirouette_body::{Keypoints, NOMINAL_STATURE_PX};
use prior::{Prior, PriorFit};

/// One view to segment
#[derive(Debug, Clone, Copy)]
pub struct SegmentView<'a> {
    /// The photo
    pub photo: &'a Photo,
    /// Joints of the person, in px of the photo
    pub keypoints: &'a Keypoints,
    /// Silhouette of the avatar in the person's pose, size of the photo
    pub prior: Option<&'a Mask>,
    /// A given silhouette, size of the photo; it is the result, and supports the other views
    pub mask: Option<&'a Mask>,
    /// Log odds of each pixel to show the person, size of the photo; used if the photo is segmented separately
    pub person_odds: Option<&'a Grid<LogOdds>>,
}

/// Options of the segmentation; every ingredient can be disabled
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SegmentOptions {
    /// Seeds from the posed avatar instead of the bones alone
    pub prior: bool,
    /// The avatar's outline also shifts the odds of undecided pixels
    pub soft_prior: bool,
    /// One pair of color models for all views
    pub shared_models: bool,
    /// The clean plate; disabled automatically when the photos are not static
    pub clean_plate: bool,
    /// Attenuation of contrast that the clean plate also has
    pub attenuation: bool,
    /// Unmixing of the border; otherwise the soft mask equals the hard one
    pub alpha: bool,
    /// Passes over all views; a third changes the IoU by 0.0001
    pub passes: usize,
    /// Cuts each photo separately, as published, with `prior`, `soft_prior` and `alpha` if they are enabled; for people
    /// in street clothes
    pub single: bool,
}

impl Default for SegmentOptions {
    fn default() -> Self {
        Self {
            prior: true,
            soft_prior: true,
            shared_models: true,
            clean_plate: true,
            attenuation: true,
            alpha: true,
            passes: 2,
            single: false,
        }
    }
}

impl SegmentOptions {
    /// Returns these options with one pass and hard borders: sufficient for a first fit of the body
    pub fn rough(&self) -> Self {
        Self {
            passes: 1,
            alpha: false,
            ..*self
        }
    }
}

/// The silhouette of the person in one photo
#[derive(Debug, Clone)]
pub struct Silhouette {
    /// Pixels that are at least half person
    pub mask: Mask,
    /// Share of each pixel that is person, 0 to 1; its 0.5 level is the outline
    pub soft: Windowed<f32>,
    /// Prior knowledge; `None` for a given mask
    pub seeds: Option<Grid<Seed>>,
    /// Whether the avatar's outline was used
    pub prior_used: bool,
}

/// Why a view has no silhouette
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SegmentError {
    /// Too few joints to locate the person
    #[error(
        "only {found} joints were found, too few to locate the person; provide a mask or better keypoints"
    )]
    NoSkeleton {
        /// Number of joints found
        found: usize,
    },
    /// The skeleton lies outside the photo
    #[error("no bone of the person lies inside the photo of {width}x{height} px")]
    Outside {
        /// Columns of the photo
        width: usize,
        /// Rows of the photo
        height: usize,
    },
    /// All pixels of the photo have the same color
    #[error("the photo of {width}x{height} px has one color only")]
    Flat {
        /// Columns of the photo
        width: usize,
        /// Rows of the photo
        height: usize,
    },
    /// The given mask has no pixel inside
    #[error("the given mask is empty")]
    EmptyMask,
    /// The given mask or prior differs from the photo in size
    #[error("{what} of {found_width}x{found_height} px for a photo of {width}x{height} px")]
    Size {
        /// Name of the mismatched raster
        what: &'static str,
        /// Its columns
        found_width: usize,
        /// Its rows
        found_height: usize,
        /// Columns of the photo
        width: usize,
        /// Rows of the photo
        height: usize,
    },
    /// The cut left no foreground pixels
    #[error("the segmentation left no foreground pixels around the bones")]
    NoPerson,
    /// The cut itself failed
    #[error("cannot segment the person: {0}")]
    Cut(#[source] GrabCutError),
    /// The caller requested cancellation
    #[error("cancelled")]
    Cancelled,
}

impl From<GrabCutError> for SegmentError {
    fn from(error: GrabCutError) -> Self {
        match error {
            GrabCutError::Cancelled => Self::Cancelled,
            other => Self::Cut(other),
        }
    }
}

/// Finds the silhouette of the person in every view
///
/// Several views are segmented as one scene, with its `background` if it is given; a single one is segmented separately,
/// with the detector's log odds. `cancelled` is polled regularly.
///
/// # Source
/// Seeds: Zwettler et al. 2021, section on segmentation. Cut: C. Rother, V. Kolmogorov, A. Blake, 2004, GrabCut.
pub fn segment(
    views: &[SegmentView],
    background: Option<&Background>,
    options: &SegmentOptions,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> Vec<Result<Silhouette, SegmentError>> {
    let fit = if options.single || views.len() < 2 {
        PriorFit::SINGLE
    } else {
        PriorFit::SCAN
    };
    let prepared: Vec<Result<Prepared, SegmentError>> = views
        .par_iter()
        .map(|view| Prepared::new(view, options, &fit))
        .collect();
    let usable = prepared.iter().filter(|p| p.is_ok()).count();
    let cuts = if prepared.iter().flatten().all(|p| p.given) {
        given_masks(views)
    } else if options.single || usable < 2 {
        cut_singly(views, &prepared, options, cancelled)
    } else {
        cut_together((views, background), &prepared, options, cancelled)
    };
    prepared
        .into_iter()
        .zip(cuts)
        .map(|(prepared, cut)| {
            let prepared = prepared?;
            let (mask, soft) = cut.unwrap_or(Err(SegmentError::Cancelled))?;
            if mask.area() == 0 {
                return Err(SegmentError::NoPerson);
            }
            Ok(Silhouette {
                mask,
                soft: Windowed::new(&soft),
                prior_used: prepared.prior_used,
                seeds: (!prepared.given).then_some(prepared.seeds),
            })
        })
        .collect()
}

/// Returns the results if no view remains to be segmented
fn given_masks(views: &[SegmentView]) -> Vec<Cut> {
    let given = |view: &SegmentView| {
        let mask = view.mask?;
        let soft = mask.map(|&v| if v { 1.0 } else { 0.0 });
        Some(Ok((mask.clone(), soft)))
    };
    views.iter().map(given).collect()
}

type Cut = Option<Result<(Mask, Grid<f32>), SegmentError>>;

fn cut_together(
    (views, background): (&[SegmentView], Option<&Background>),
    prepared: &[Result<Prepared, SegmentError>],
    options: &SegmentOptions,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> Vec<Cut> {
    let scene: Vec<SceneView> = views
        .iter()
        .zip(prepared)
        .filter_map(|(view, prepared)| {
            let prepared = prepared.as_ref().ok()?;
            Some(SceneView {
                photo: view.photo,
                seeds: &prepared.seeds,
                prior: prepared.odds.as_ref().filter(|_| options.soft_prior),
                scale: prepared.scale,
            })
        })
        .collect();
    let scene_options = SceneOptions {
        passes: options.passes,
        shared_models: options.shared_models,
        clean_plate: options.clean_plate.then(CleanPlateOptions::default),
        attenuation: options.attenuation,
        unmix_border: options.alpha,
        ..SceneOptions::default()
    };
    let background = background.map(|background| (&background.photo, &background.known));
    let mut masks = segment_scene(&scene, background, &scene_options, cancelled)
        .masks
        .into_iter();
    prepared
        .iter()
        .map(|prepared| {
            prepared.as_ref().ok()?;
            Some(match masks.next()? {
                Ok(found) => Ok((found.mask, found.soft)),
                Err(error) => Err(error.into()),
            })
        })
        .collect()
}

fn cut_singly(
    views: &[SegmentView],
    prepared: &[Result<Prepared, SegmentError>],
    options: &SegmentOptions,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> Vec<Cut> {
    views
        .par_iter()
        .zip(prepared)
        .map(|(view, prepared)| {
            let prepared = prepared.as_ref().ok()?;
            let cut = grabcut(
                view.photo,
                &prepared.seeds,
                prepared.odds.as_ref().filter(|_| options.soft_prior),
                &GrabCutOptions::default(),
                cancelled,
            );
            Some(match cut {
                Ok(mask) if prepared.given => {
                    let soft = mask.map(|&v| if v { 1.0 } else { 0.0 });
                    Ok((mask, soft))
                }
                Ok(mask) => {
                    let mask = clean_mask(&mask, prepared.scale);
                    if !options.alpha {
                        let soft = mask.map(|&v| if v { 1.0 } else { 0.0 });
                        return Some(Ok((mask, soft)));
                    }
                    let mut soft = soft_border(view.photo, &mask, None, prepared.scale);
                    let mask = clean_soft_mask(&mut soft, prepared.scale);
                    Ok((mask, soft))
                }
                Err(error) => Err(error.into()),
            })
        })
        .collect()
}

/// Prior knowledge of a view, without its colors
struct Prepared {
    seeds: Grid<Seed>,
    odds: Option<Grid<LogOdds>>,
    scale: f64,
    given: bool,
    prior_used: bool,
}

impl Prepared {
    fn new(
        view: &SegmentView,
        options: &SegmentOptions,
        fit: &PriorFit,
    ) -> Result<Self, SegmentError> {
        let (width, height) = (view.photo.width(), view.photo.height());
        if let Some(mask) = view.mask {
            check_size("mask", view.photo, mask)?;
            let (_, y0, _, y1) = mask.bounding_box().ok_or(SegmentError::EmptyMask)?;
            return Ok(Self {
                seeds: mask.map(|&v| if v { Seed::Person } else { Seed::Background }),
                odds: None,
                scale: (y1 - y0) as f64 / NOMINAL_STATURE_PX,
                given: true,
                prior_used: false,
            });
        }
        if let Some(prior) = view.prior {
            check_size("prior", view.photo, prior)?;
        }
        if let Some(odds) = view.person_odds {
            check_size("log odds", view.photo, odds)?;
        }
        let colors = view.photo.as_slice();
        if colors.iter().all(|color| Some(color) == colors.first()) {
            return Err(SegmentError::Flat { width, height });
        }
        let lines = SeedLines::new(view.keypoints)?;
        let prior = view.prior.filter(|_| options.prior);
        let scale = prior
            .and_then(stature_px)
            .map_or(lines.scale(), |px| px / NOMINAL_STATURE_PX);
        let posed = prior.and_then(|prior| Prior::new(prior, &lines, scale, fit));
        let prior_used = posed.is_some();
        let scale = if prior_used { scale } else { lines.scale() };
        let Prior { seeds, odds } = match (posed, view.person_odds) {
            (Some(posed), Some(detected)) if fit.uses_person_odds => posed.with_detected(detected),
            (Some(posed), _) => posed,
            (None, detected) => {
                let seeds = lines.seeds(width, height);
                if !seeds.as_slice().iter().any(|seed| seed.person()) {
                    return Err(SegmentError::Outside { width, height });
                }
                match detected.filter(|_| fit.uses_person_odds) {
                    Some(detected) => Prior::of_seeds(seeds).with_detected(detected),
                    None => Prior::of_seeds(seeds),
                }
            }
        };
        Ok(Self {
            seeds,
            odds,
            scale,
            given: false,
            prior_used,
        })
    }
}

/// Returns the height of the avatar's silhouette, in px
fn stature_px(avatar: &Mask) -> Option<f64> {
    let (_, y0, _, y1) = avatar.bounding_box()?;
    Some((y1 - y0) as f64)
}

fn check_size<T>(what: &'static str, photo: &Photo, found: &Grid<T>) -> Result<(), SegmentError> {
    if photo.same_size(found) {
        return Ok(());
    }
    Err(SegmentError::Size {
        what,
        found_width: found.width(),
        found_height: found.height(),
        width: photo.width(),
        height: photo.height(),
    })
}
