//! Joint segmentation of all photos of one person in front of one background.
//!
//! Views share one color model of the person and one of the background, and, if the camera is static, a clean plate.
//! Works in passes: models and clean plate are estimated from the seeds first, then from the previous pass.

use pirouette_geom::morphology::dilate;
use pirouette_geom::parallel::prelude::*;
use pirouette_geom::{Grid, Mask};

use crate::border::{clean_soft_mask, soft_border};
use crate::clean_plate::{BackgroundView, CleanPlate, CleanPlateOptions};
use crate::color_model::{ColorModel, ColorModelOptions};
use crate::color_table::{ColorCells, ColorTable, ModelPair};
use crate::grabcut::{GrabCutError, check_size};
use crate::links::{Contrast, contrast_scale};
pub use crate::scene_view::SceneView;
use crate::seeds::Seed;
use crate::view_cut::{Evidence, cut_view};

/// Options of [`segment_scene`]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneOptions {
    /// Passes; the second takes its samples from the first, a third has almost no effect
    pub passes: usize,
    /// Fits one pair of color models for all views instead of one pair per view
    pub shared_models: bool,
    /// Options of the clean plate; `None` for a moving camera
    pub clean_plate: Option<CleanPlateOptions>,
    /// Maximum noise level of the clean plate, in levels; above, the camera moved and the plate is not used
    pub max_noise_level: f32,
    /// Attenuates contrast that the clean plate also has
    pub attenuation: bool,
    /// Cost of separating two neighbors of equal color
    pub smoothness: f32,
    /// Bound of one pixel's color term, as log odds
    pub color_limit: f32,
    /// Distance around the undecided band that provides background samples, in px of a person of 800 px
    pub sample_reach_px: f64,
    /// Options of the color models of both sides
    pub color_model: ColorModelOptions,
    /// Unmixes the border; otherwise the soft mask equals the hard one
    pub unmix_border: bool,
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self {
            passes: 2,
            shared_models: true,
            clean_plate: Some(CleanPlateOptions::default()),
            max_noise_level: 12.0,
            attenuation: true,
            smoothness: 50.0,
            color_limit: 12.0,
            sample_reach_px: 20.0,
            color_model: ColorModelOptions::default(),
            unmix_border: true,
        }
    }
}

/// Segmentation of one photo
#[derive(Debug, Clone)]
pub struct SceneMask {
    /// The soft mask thresholded at one half; one component, with large holes open
    pub mask: Mask,
    /// Fraction of each pixel that is person, 0 to 1
    pub soft: Grid<f32>,
}

/// Result of [`segment_scene`]
#[derive(Debug, Clone)]
pub struct SceneResult {
    /// One mask per view
    pub masks: Vec<Result<SceneMask, GrabCutError>>,
    /// Whether any view used a clean plate
    pub clean_plate_used: bool,
}

/// In later passes the clean plate uses pixels this far outside the last mask, in px of a person of 800 px
const CLEAN_PLATE_MARGIN_PX: f64 = 6.0;

/// Minimum absolute log odds of a clear pixel in the first pass
///
/// 160 rendered photos: 6 and 4 give the same masks as the graph of all pixels, 3 loses some of them.
const FIRST_MIN_ODDS: f32 = 4.0;

/// The same for later passes, whose odds are more reliable
///
/// 160 rendered photos: 9 gives the same masks as the graph of all pixels, 7.5 the same IoUs to four digits; 6 and 4
/// lose a poster behind one person.
const MIN_ODDS: f32 = 7.5;

/// Sampling interval of the shared models, in pixels
const SHARED_SAMPLE_STEP: usize = 4;

/// Segments all photos of one scene together
///
/// Views may differ in size; there is one clean plate per photo size, from at least two views. A failed view does not
/// affect the others. `background` is a picture of the scene without the person, with the mask of where it is known; it
/// completes the clean plate where the person hides the background in all views.
///
/// # Source
/// After C. Rother, V. Kolmogorov, A. Blake, 2004, GrabCut, with the background model of J. Sun, W. Zhang,
/// X. Tang, H. Shum, 2006, Background cut: a Gaussian per pixel mixed with the global model.
pub fn segment_scene(
    views: &[SceneView],
    background: Option<BackgroundView>,
    options: &SceneOptions,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> SceneResult {
    let mut states: Vec<Result<ViewState, GrabCutError>> = views
        .par_iter()
        .map(|view| ViewState::new(view, options))
        .collect();
    let cells = ColorCells::new(views.par_iter().map(|view| (view.photo, view.seeds)));
    let last = options.passes.max(1) - 1;
    for pass in 0..last {
        let pass = Pass::new(pass == 0, (views, background), &states, &cells, options);
        let next: Vec<Result<Mask, GrabCutError>> = states
            .par_iter()
            .enumerate()
            .map(|(index, state)| pass.cut(index, state.as_ref().map_err(|e| *e)?, cancelled))
            .collect();
        for (state, next) in states.iter_mut().zip(next) {
            match (state.as_mut(), next) {
                (Ok(state), Ok(mask)) => state.mask = mask,
                (_, Err(error)) => *state = Err(error),
                _ => {}
            }
        }
    }
    let pass = Pass::new(last == 0, (views, background), &states, &cells, options);
    let masks = states
        .into_par_iter()
        .enumerate()
        .map(|(index, state)| {
            let mask = pass.cut(index, &state?, cancelled)?;
            Ok(finish_mask(
                &views[index],
                mask,
                pass.clean_plates.of(index),
                options,
            ))
        })
        .collect();
    SceneResult {
        masks,
        clean_plate_used: pass.clean_plates.any(),
    }
}

/// Shared inputs of all cuts of one pass
struct Pass<'a> {
    first: bool,
    views: &'a [SceneView<'a>],
    options: &'a SceneOptions,
    clean_plates: CleanPlates,
    models: Models<'a>,
}

impl<'a> Pass<'a> {
    /// Estimates clean plates and color models from the result of the previous pass
    fn new(
        first: bool,
        (views, background): (&'a [SceneView], Option<BackgroundView>),
        states: &[Result<ViewState, GrabCutError>],
        cells: &'a ColorCells,
        options: &'a SceneOptions,
    ) -> Self {
        let margin = (!first).then_some(CLEAN_PLATE_MARGIN_PX);
        let clean_plates = CleanPlates::estimate((views, background), states, options, margin);
        let models = Models::fit(
            views,
            states,
            first.then_some(&clean_plates),
            cells,
            options,
        );
        Self {
            first,
            views,
            options,
            clean_plates,
            models,
        }
    }

    fn cut(
        &self,
        index: usize,
        state: &ViewState,
        cancelled: &(dyn Fn() -> bool + Sync),
    ) -> Result<Mask, GrabCutError> {
        if cancelled() {
            return Err(GrabCutError::Cancelled);
        }
        let (first, options) = (self.first, self.options);
        let clean_plate = self.clean_plates.of(index);
        let evidence = Evidence {
            table: self.models.of(index)?,
            clean_plate,
            color_limit: options.color_limit,
            mask: (!first).then_some(&state.mask),
            min_odds: if first { FIRST_MIN_ODDS } else { MIN_ODDS },
            contrast: Contrast {
                smoothness: options.smoothness,
                beta: state.beta,
                clean_plate: clean_plate.filter(|_| options.attenuation),
            },
        };
        Ok(cut_view(&self.views[index], &evidence).unwrap_or_else(|| state.mask.clone()))
    }
}

/// State of a view between passes
struct ViewState {
    mask: Mask,
    /// Pixels that provide background samples unless they are person
    sampled: Mask,
    /// See [`contrast_scale`]
    beta: f32,
}

impl ViewState {
    fn new(view: &SceneView, options: &SceneOptions) -> Result<Self, GrabCutError> {
        check_size("seeds", view.photo, view.seeds)?;
        if let Some(prior) = view.prior {
            check_size("prior", view.photo, prior)?;
        }
        let reach = options.sample_reach_px * view.scale;
        let mut band = view.seeds.map(|seed| *seed != Seed::Background);
        // views without undecided pixels still provide samples of the background around the person
        if reach >= 1.0 {
            band = dilate(&band, reach);
        }
        Ok(Self {
            mask: view.seeds.map(|seed| seed.person()),
            sampled: band,
            beta: contrast_scale(view.photo, view.seeds),
        })
    }
}

/// Clean plates, one per photo size
struct CleanPlates {
    plates: Vec<CleanPlate>,
    /// Index of each view's clean plate
    index: Vec<Option<usize>>,
}

impl CleanPlates {
    fn none(count: usize) -> Self {
        Self {
            plates: Vec::new(),
            index: vec![None; count],
        }
    }

    /// `margin`: distance from the masks beyond which pixels are background, in px of a person of 800 px; `None`: as
    /// given by the seeds
    fn estimate(
        (views, background): (&[SceneView], Option<BackgroundView>),
        states: &[Result<ViewState, GrabCutError>],
        options: &SceneOptions,
        margin: Option<f64>,
    ) -> Self {
        let mut clean_plates = Self::none(views.len());
        let Some(clean_plate_options) = options.clean_plate else {
            return clean_plates;
        };
        let mut done = vec![false; views.len()];
        for first in 0..views.len() {
            let group: Vec<usize> = (first..views.len())
                .filter(|&i| {
                    !done[i] && states[i].is_ok() && views[i].photo.same_size(views[first].photo)
                })
                .collect();
            for &i in &group {
                done[i] = true;
            }
            if group.len() < 2 {
                continue;
            }
            let backgrounds: Vec<Mask> = group
                .par_iter()
                .map(|&i| match (&states[i], margin) {
                    (Ok(state), Some(margin)) => {
                        let near = dilate(&state.mask, margin * views[i].scale);
                        outside(&near, views[i].seeds)
                    }
                    _ => views[i].seeds.map(|seed| *seed == Seed::Background),
                })
                .collect();
            let group_views: Vec<_> = group
                .iter()
                .zip(&backgrounds)
                .map(|(&i, background)| (views[i].photo, background))
                .collect();
            let Some(mut clean_plate) = CleanPlate::estimate(&group_views, &clean_plate_options)
            else {
                continue;
            };
            if clean_plate.noise_level() > options.max_noise_level {
                continue;
            }
            if let Some(background) = background {
                clean_plate.complete(background, options.max_noise_level, &clean_plate_options);
            }
            for &i in &group {
                clean_plates.index[i] = Some(clean_plates.plates.len());
            }
            clean_plates.plates.push(clean_plate);
        }
        clean_plates
    }

    fn of(&self, view: usize) -> Option<&CleanPlate> {
        self.index[view].map(|plate| &self.plates[plate])
    }

    fn any(&self) -> bool {
        !self.plates.is_empty()
    }
}

/// Returns the pixels that are not near the mask or are background by their seeds
fn outside(near: &Mask, seeds: &Grid<Seed>) -> Mask {
    let values = near
        .as_slice()
        .iter()
        .zip(seeds.as_slice())
        .map(|(&near, &seed)| !near || seed == Seed::Background)
        .collect();
    Mask::from_vec(near.width(), near.height(), values)
}

/// One pair of color models for all views, or one per view, as tables
enum Models<'a> {
    Shared(Result<ColorTable<'a>, GrabCutError>),
    Own(Vec<Result<ColorTable<'a>, GrabCutError>>),
}

impl<'a> Models<'a> {
    /// With `clean_plates`, background colors are not used as samples of the person
    fn fit(
        views: &[SceneView],
        states: &[Result<ViewState, GrabCutError>],
        clean_plates: Option<&CleanPlates>,
        cells: &'a ColorCells,
        options: &SceneOptions,
    ) -> Self {
        let samples: Vec<[Vec<[u8; 3]>; 2]> = views
            .par_iter()
            .zip(states)
            .enumerate()
            .map(|(index, (view, state))| match state {
                Ok(state) => sample_colors(
                    view,
                    state,
                    clean_plates.and_then(|clean_plates| clean_plates.of(index)),
                ),
                Err(_) => [Vec::new(), Vec::new()],
            })
            .collect();
        if options.shared_models {
            let all = |side: usize| -> Vec<[u8; 3]> {
                samples.iter().flat_map(|s| &s[side]).copied().collect()
            };
            let pair = fit_pair(&all(0), &all(1), &options.color_model);
            Self::Shared(pair.map(|pair| ColorTable::new(&pair, cells)))
        } else {
            let own = samples.par_iter().map(|[person, background]| {
                let pair = fit_pair(person, background, &options.color_model)?;
                Ok(ColorTable::new(&pair, cells))
            });
            Self::Own(own.collect())
        }
    }

    fn of(&self, view: usize) -> Result<&ColorTable<'a>, GrabCutError> {
        match self {
            Self::Shared(table) => table.as_ref().map_err(|error| *error),
            Self::Own(tables) => tables[view].as_ref().map_err(|error| *error),
        }
    }
}

/// Samples colors of the person, except those of the `clean_plate`, and of the background near the person
fn sample_colors(
    view: &SceneView,
    state: &ViewState,
    clean_plate: Option<&CleanPlate>,
) -> [Vec<[u8; 3]>; 2] {
    let mut sides = [Vec::new(), Vec::new()];
    let mut met = [0_usize; 2];
    for y in 0..view.photo.height() {
        let masks = state.mask.row(y).iter().zip(state.sampled.row(y));
        for (x, (&color, (&person, &sampled))) in view.photo.row(y).iter().zip(masks).enumerate() {
            let side = match (person, sampled) {
                (true, _) => 0,
                (false, true) => 1,
                (false, false) => continue,
            };
            let taken = met[side].is_multiple_of(SHARED_SAMPLE_STEP)
                && !(person
                    && clean_plate
                        .is_some_and(|clean_plate| clean_plate.is_background_color(x, y, color)));
            if taken {
                sides[side].push(color);
            }
            met[side] += 1;
        }
    }
    sides
}

fn fit_pair(
    person: &[[u8; 3]],
    background: &[[u8; 3]],
    options: &ColorModelOptions,
) -> Result<ModelPair, GrabCutError> {
    let fit = |side: &'static str, samples: &[[u8; 3]]| {
        ColorModel::fit(samples, options).ok_or(GrabCutError::TooFewSamples {
            side,
            count: samples.len(),
        })
    };
    let (person, background) =
        pirouette_geom::parallel::join(|| fit("person", person), || fit("background", background));
    Ok(ModelPair {
        person: person?,
        background: background?,
    })
}

fn finish_mask(
    view: &SceneView,
    mask: Mask,
    clean_plate: Option<&CleanPlate>,
    options: &SceneOptions,
) -> SceneMask {
    let decided = !view.seeds.as_slice().iter().any(|seed| seed.undecided());
    if decided || !options.unmix_border {
        let soft = mask.map(|&v| if v { 1.0 } else { 0.0 });
        return SceneMask { mask, soft };
    }
    let mut soft = soft_border(view.photo, &mask, clean_plate, view.scale);
    let mask = clean_soft_mask(&mut soft, view.scale);
    SceneMask { mask, soft }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 60;
    const HEIGHT: usize = 60;

    /// Photo, seeds and true mask
    type Example = (Grid<[u8; 3]>, Grid<Seed>, Mask);

    /// A wall with a poster in the person's color, and a person (an upright bar) at column `at`
    fn view(at: usize, camera_shift: usize) -> Example {
        let truth = Grid::from_fn(WIDTH, HEIGHT, |x, y| {
            (at..at + 10).contains(&x) && (15..55).contains(&y)
        });
        let photo = Grid::from_fn(WIDTH, HEIGHT, |x, y| {
            let noise = ((x * 7919 + y * 104_729 + at * 31) % 9) as u8;
            let wall = x + camera_shift;
            if truth[(x, y)] || ((24..36).contains(&wall) && (5..25).contains(&y)) {
                [150 + noise, 60, 40 + noise]
            } else if (wall / 3).is_multiple_of(2) {
                [90 + noise, 110, 120]
            } else {
                [60, 80 + noise, 90]
            }
        });
        let seeds = Grid::from_fn(WIDTH, HEIGHT, |x, y| {
            let to_the_side = x.abs_diff(at + 5);
            match y {
                20..50 if to_the_side < 2 => Seed::Person,
                12..58 if to_the_side < 5 => Seed::ProbablePerson,
                8..59 if to_the_side < 16 => Seed::ProbableBackground,
                _ => Seed::Background,
            }
        });
        (photo, seeds, truth)
    }

    fn run(views: &[Example], options: &SceneOptions) -> (SceneResult, f64) {
        let scene: Vec<_> = views
            .iter()
            .map(|(photo, seeds, _)| SceneView {
                photo,
                seeds,
                prior: None,
                scale: 0.3,
            })
            .collect();
        let result = segment_scene(&scene, None, options, &|| false);
        let worst = result
            .masks
            .iter()
            .zip(views)
            .map(|(mask, (_, _, truth))| mask.as_ref().map_or(0.0, |m| m.mask.iou(truth)))
            .fold(1.0, f64::min);
        (result, worst)
    }

    #[test]
    fn the_clean_plate_separates_the_person_from_a_poster_of_the_same_color() {
        let views: Vec<_> = [3, 12, 36, 47].map(|at| view(at, 0)).into();
        let (result, with_clean_plate) = run(&views, &SceneOptions::default());
        assert!(result.clean_plate_used);
        assert!(with_clean_plate > 0.95, "{with_clean_plate}");
        let options = SceneOptions {
            clean_plate: None,
            ..SceneOptions::default()
        };
        let (result, without) = run(&views, &options);
        assert!(
            !result.clean_plate_used && without < with_clean_plate,
            "{without} {with_clean_plate}"
        );
    }

    #[test]
    fn a_moving_camera_gives_masks_without_a_clean_plate() {
        let views: Vec<_> = (0..5).map(|i| view(5 + 9 * i, 3 * i)).collect();
        let (result, worst) = run(&views, &SceneOptions::default());
        assert!(!result.clean_plate_used);
        assert!(worst > 0.6, "{worst}");
    }

    #[test]
    fn views_of_other_sizes_and_failed_ones_do_not_affect_others() {
        let mut views: Vec<_> = [5, 25, 45].map(|at| view(at, 0)).into();
        let (photo, seeds, truth) = view(30, 0);
        views.push((
            photo.crop(10, 0, 50, 60),
            seeds.crop(10, 0, 50, 60),
            truth.crop(10, 0, 50, 60),
        ));
        views.push((photo, Grid::filled(3, 3, Seed::Person), truth));
        let (result, _) = run(&views, &SceneOptions::default());
        assert!(result.masks[..4].iter().all(Result::is_ok));
        assert!(matches!(result.masks[4], Err(GrabCutError::Size { .. })));
    }

    #[test]
    fn decided_views_are_unchanged_and_cancelling_stops() {
        let views: Vec<_> = [5, 25].map(|at| view(at, 0)).into();
        let decided = views[0]
            .2
            .map(|&v| if v { Seed::Person } else { Seed::Background });
        let scene = [
            SceneView {
                photo: &views[0].0,
                seeds: &decided,
                prior: None,
                scale: 0.3,
            },
            SceneView {
                photo: &views[1].0,
                seeds: &views[1].1,
                prior: None,
                scale: 0.3,
            },
        ];
        let result = segment_scene(&scene, None, &SceneOptions::default(), &|| false);
        assert_eq!(result.masks[0].as_ref().unwrap().mask, views[0].2);
        let stopped = segment_scene(&scene, None, &SceneOptions::default(), &|| true);
        assert!(matches!(stopped.masks[1], Err(GrabCutError::Cancelled)));
        assert!(
            segment_scene(&[], None, &SceneOptions::default(), &|| false)
                .masks
                .is_empty()
        );
    }
}
