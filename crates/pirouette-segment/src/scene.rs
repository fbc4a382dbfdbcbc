//! All photos of one person before one background, segmented together.
//!
//! Views share one color model of the person and one of the background, and, when the camera stood still, a
//! background plate. Works in passes: models and plate come from the seeds first, then from the last pass.

use pirouette_geom::morphology::{dilate, erode};
use pirouette_geom::{Grid, Mask};
use rayon::prelude::*;

use crate::band::BandCut;
use crate::border::{clean, soft_border, tidy_soft};
use crate::color_model::{ColorModel, ColorModelOptions};
use crate::grabcut::{GrabCutError, check_size, log_sum_exp};
use crate::half::HalfView;
use crate::plate::{BackgroundPlate, PlateOptions};
use crate::seeds::{LogOdds, Seed};

/// One photo with what is known of it beforehand
#[derive(Debug, Clone, Copy)]
pub struct SceneView<'a> {
    /// The photo
    pub photo: &'a Grid<[u8; 3]>,
    /// One per pixel; when nothing is undecided the view only helps the others
    pub seeds: &'a Grid<Seed>,
    /// Adds to the log odds of the colors; `None` is even odds everywhere
    pub prior: Option<&'a Grid<LogOdds>>,
    /// Height of the person in px over 800; all lengths in px grow with it
    pub scale: f64,
}

/// How the photos of a scene are segmented
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneOptions {
    /// Passes; the second takes its samples from the first, a third changes nothing worth its time
    pub passes: usize,
    /// Whether the first of several passes works on photos of half the size, and the next ones on its border
    ///
    /// Half the time; on five rendered scans the mean IoU is lower by 0.0006.
    pub coarse_start: bool,
    /// One pair of color models for all views instead of a pair for each
    pub shared_models: bool,
    /// Use of the background plate; `None` for a camera that moves
    pub plate: Option<PlateOptions>,
    /// Views deviate by fewer levels than this where the camera stood still; above, the plate is dropped
    pub max_unrest: f32,
    /// Whether contrast that the plate shows too counts less
    pub attenuation: bool,
    /// Cost of parting two alike neighbors
    pub smoothness: f32,
    /// Largest say of one pixel's color, as log odds
    pub color_limit: f32,
    /// Background samples come from this far around the undecided band, in px of a person of 800 px
    pub sample_reach_px: f64,
    /// The color models of both sides
    pub color_model: ColorModelOptions,
    /// Whether the border is unmixed; otherwise the soft mask is the blurred cut
    pub unmix_border: bool,
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self {
            passes: 2,
            coarse_start: true,
            shared_models: true,
            plate: Some(PlateOptions::default()),
            max_unrest: 12.0,
            attenuation: true,
            smoothness: 50.0,
            color_limit: 12.0,
            sample_reach_px: 20.0,
            color_model: ColorModelOptions::default(),
            unmix_border: true,
        }
    }
}

/// The person in one photo
#[derive(Debug, Clone)]
pub struct SceneMask {
    /// The soft mask where it is at least one half; one component, large holes open
    pub mask: Mask,
    /// Share of each pixel that is person, 0 to 1
    pub soft: Grid<f32>,
}

/// What came of a scene
#[derive(Debug, Clone)]
pub struct SceneResult {
    /// One per view
    pub masks: Vec<Result<SceneMask, GrabCutError>>,
    /// Whether a background plate was used, by any view
    pub plate_used: bool,
}

/// Share of the plate in the density of the background; the rest is for what moved or throws light
const PLATE_SHARE: f32 = 0.95;

/// In later passes the plate takes what is this far outside the last mask, in px of a person of 800 px
const PLATE_MARGIN_PX: f64 = 6.0;

/// The same for the final plate, which unmixes the border
const FINAL_PLATE_MARGIN_PX: f64 = 4.0;

/// Smaller people lose too much at half their size
const COARSE_MIN_SCALE: f64 = 0.6;

/// Cost of parting neighbors at half the size over that at the full size
///
/// Pixels are half as many along an outline, and their contrast is higher. From 1 to 1/2, gaps between arm and trunk
/// close (mean IoU of a scan lower by up to 0.007); 1/3 to 1/6 are alike.
const COARSE_SMOOTHNESS: f32 = 0.25;

/// After a pass at half the size only what is this near to the border is decided anew, in px of a person of 800 px
const REFINED_PX: f64 = 12.0;

/// The same around pixels whose colors contradict the coarse mask
const DOUBT_PX: f64 = 3.0;

/// A color contradicts the mask by log odds of more than this
const DOUBT_ODDS: f32 = 1.0;

/// Every so many-th pixel is a sample of the shared models
const SHARED_SAMPLE_STEP: usize = 4;

/// Segments all photos of one scene together
///
/// Views may differ in size; the plate is made of the views of each size apart, and needs two of them. A view that
/// fails takes no other one down.
///
/// # Source
/// After C. Rother, V. Kolmogorov, A. Blake, 2004, GrabCut, with the background model of J. Sun, W. Zhang,
/// X. Tang, H. Shum, 2006, Background cut: a Gaussian per pixel mixed with the global model.
pub fn segment_scene(
    views: &[SceneView],
    options: &SceneOptions,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> SceneResult {
    let mut states = start(views, options);
    let mut plate_used = false;
    let passes = options.passes.max(1);
    let large = views.iter().all(|view| view.scale >= COARSE_MIN_SCALE);
    let coarse = options.coarse_start && passes > 1 && large;
    if coarse {
        let halves: Vec<HalfView> = views.par_iter().map(HalfView::new).collect();
        let half_views: Vec<SceneView> = halves.iter().map(HalfView::view).collect();
        let half_options = SceneOptions {
            smoothness: options.smoothness * COARSE_SMOOTHNESS,
            ..*options
        };
        let mut half_states = start(&half_views, &half_options);
        plate_used = pass(
            &half_views,
            &mut half_states,
            None,
            &half_options,
            cancelled,
        );
        states
            .par_iter_mut()
            .zip(half_states)
            .zip(views)
            .for_each(|((state, half), view)| match (state.as_mut(), half) {
                (Ok(state), Ok(half)) => state.refine(view, &half),
                (Ok(_), Err(GrabCutError::Cancelled)) => *state = Err(GrabCutError::Cancelled),
                // The full size may do where half of it is too little.
                _ => {}
            });
    }
    for round in usize::from(coarse)..passes {
        let margin = (round > 0).then_some(PLATE_MARGIN_PX);
        plate_used = pass(views, &mut states, margin, options, cancelled);
    }
    let plates = if options.unmix_border {
        Plates::estimate(views, &states, options, Some(FINAL_PLATE_MARGIN_PX))
    } else {
        Plates::none(views.len())
    };
    let masks = views
        .par_iter()
        .zip(states)
        .enumerate()
        .map(|(index, (view, state))| {
            let state = state?;
            if cancelled() {
                return Err(GrabCutError::Cancelled);
            }
            Ok(finish(view, state, plates.of(index), options))
        })
        .collect();
    SceneResult { masks, plate_used }
}

fn start(views: &[SceneView], options: &SceneOptions) -> Vec<Result<ViewState, GrabCutError>> {
    let start = |view| ViewState::new(view, options);
    views.par_iter().map(start).collect()
}

/// Plates and models from the masks so far, then all views cut anew; returns whether there is a plate
///
/// `margin` as of [`Plates::estimate`].
fn pass(
    views: &[SceneView],
    states: &mut [Result<ViewState, GrabCutError>],
    margin: Option<f64>,
    options: &SceneOptions,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> bool {
    let plates = Plates::estimate(views, states, options, margin);
    let models = Models::fit(views, states, options);
    let next: Vec<Option<Result<ViewCut, GrabCutError>>> = views
        .par_iter()
        .zip(&*states)
        .enumerate()
        .map(|(index, (view, state))| {
            let state = state.as_ref().ok()?;
            if cancelled() {
                return Some(Err(GrabCutError::Cancelled));
            }
            let plate = plates.of(index);
            let models = models.of(index);
            Some(models.map(|pair| cut_view(view, state, pair, plate, options)))
        })
        .collect();
    for (state, next) in states.iter_mut().zip(next) {
        match (state.as_mut(), next) {
            (Ok(state), Some(Ok(cut))) => {
                state.mask = cut.mask;
                state.doubts = cut.doubts;
            }
            (Ok(_), Some(Err(error))) => *state = Err(error),
            _ => {}
        }
    }
    plates.any()
}

/// What changes from pass to pass
struct ViewState {
    mask: Mask,
    /// Pixels whose colors contradict the mask
    doubts: Vec<(u32, u32)>,
    /// Seeds in which what lies far from the border of a coarse mask is decided
    narrowed: Option<Grid<Seed>>,
    /// Pixels whose colors are samples of the background, when they are not person
    sampled: Mask,
}

impl ViewState {
    fn new(view: &SceneView, options: &SceneOptions) -> Result<Self, GrabCutError> {
        check_size("seeds", view.photo, view.seeds)?;
        if let Some(prior) = view.prior {
            check_size("prior", view.photo, prior)?;
        }
        let reach = options.sample_reach_px * view.scale;
        let mut band = view.seeds.map(|seed| *seed != Seed::Background);
        // a view without a band of its own still shows the background around the person
        if reach >= 1.0 {
            band = dilate(&band, reach);
        }
        Ok(Self {
            mask: view.seeds.map(|seed| seed.person()),
            doubts: Vec::new(),
            narrowed: None,
            sampled: band,
        })
    }

    /// Takes the mask of the photo at half its size; its border, and where colors contradict it, remain to be decided
    ///
    /// Gaps between arm and trunk are narrow enough to be closed at half the size.
    fn refine(&mut self, view: &SceneView, half: &Self) {
        let reach = REFINED_PX * view.scale / 2.0;
        let outer = dilate(&half.mask, reach);
        let inner = erode(&half.mask, reach);
        let (width, height) = (half.mask.width(), half.mask.height());
        let mut doubtful = Mask::filled(width, height, false);
        for &(x, y) in &half.doubts {
            doubtful[(x as usize, y as usize)] = true;
        }
        let doubtful = dilate(&doubtful, DOUBT_PX * view.scale / 2.0);
        let mut narrowed = view.seeds.clone();
        for y in 0..self.mask.height() {
            let half_y = (y / 2).min(height - 1);
            let [person, outer, inner, doubtful] =
                [&half.mask, &outer, &inner, &doubtful].map(|mask| mask.row(half_y));
            let mask = self.mask.row_mut(y).iter_mut();
            for (x, (decided, seed)) in mask.zip(narrowed.row_mut(y)).enumerate() {
                let at = (x / 2).min(width - 1);
                if !seed.undecided() {
                    continue;
                }
                *decided = person[at];
                *seed = match (doubtful[at], outer[at], inner[at]) {
                    (false, false, _) => Seed::Background,
                    (false, _, true) => Seed::Person,
                    _ => *seed,
                };
            }
        }
        self.narrowed = Some(narrowed);
    }
}

/// Background plates, one for each size of the photos
struct Plates {
    plates: Vec<BackgroundPlate>,
    /// For each view its plate
    index: Vec<Option<usize>>,
}

impl Plates {
    fn none(count: usize) -> Self {
        Self {
            plates: Vec::new(),
            index: vec![None; count],
        }
    }

    /// `margin`: distance from the masks that is surely background, in px of a person of 800 px; `None`: the seeds
    /// tell
    fn estimate(
        views: &[SceneView],
        states: &[Result<ViewState, GrabCutError>],
        options: &SceneOptions,
        margin: Option<f64>,
    ) -> Self {
        let mut plates = Self::none(views.len());
        let Some(plate_options) = options.plate else {
            return plates;
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
            let Some(plate) = BackgroundPlate::estimate(&group_views, &plate_options) else {
                continue;
            };
            if plate.unrest() > options.max_unrest {
                continue;
            }
            for &i in &group {
                plates.index[i] = Some(plates.plates.len());
            }
            plates.plates.push(plate);
        }
        plates
    }

    fn of(&self, view: usize) -> Option<&BackgroundPlate> {
        self.index[view].map(|plate| &self.plates[plate])
    }

    fn any(&self) -> bool {
        !self.plates.is_empty()
    }
}

/// What is not near the mask, or was background from the start
fn outside(near: &Mask, seeds: &Grid<Seed>) -> Mask {
    let values = near
        .as_slice()
        .iter()
        .zip(seeds.as_slice())
        .map(|(&near, &seed)| !near || seed == Seed::Background)
        .collect();
    Mask::from_vec(near.width(), near.height(), values)
}

/// Color models of person and background
struct ModelPair {
    person: ColorModel,
    background: ColorModel,
}

/// One pair for all views, or one for each
enum Models {
    Shared(Result<ModelPair, GrabCutError>),
    Own(Vec<Result<ModelPair, GrabCutError>>),
}

impl Models {
    fn fit(
        views: &[SceneView],
        states: &[Result<ViewState, GrabCutError>],
        options: &SceneOptions,
    ) -> Self {
        let samples: Vec<[Vec<[u8; 3]>; 2]> = views
            .par_iter()
            .zip(states)
            .map(|(view, state)| match state {
                Ok(state) => sample(view, state, SHARED_SAMPLE_STEP),
                Err(_) => [Vec::new(), Vec::new()],
            })
            .collect();
        if options.shared_models {
            let all = |side: usize| -> Vec<[u8; 3]> {
                samples.iter().flat_map(|s| &s[side]).copied().collect()
            };
            Self::Shared(fit_pair(&all(0), &all(1), &options.color_model))
        } else {
            Self::Own(
                samples
                    .par_iter()
                    .map(|[person, background]| fit_pair(person, background, &options.color_model))
                    .collect(),
            )
        }
    }

    fn of(&self, view: usize) -> Result<&ModelPair, GrabCutError> {
        match self {
            Self::Shared(pair) => pair.as_ref().map_err(|error| *error),
            Self::Own(pairs) => pairs[view].as_ref().map_err(|error| *error),
        }
    }
}

/// Colors of the person and of the background near it
fn sample(view: &SceneView, state: &ViewState, step: usize) -> [Vec<[u8; 3]>; 2] {
    let mut sides = [Vec::new(), Vec::new()];
    let mut met = [0_usize; 2];
    for ((&color, &person), &sampled) in view
        .photo
        .as_slice()
        .iter()
        .zip(state.mask.as_slice())
        .zip(state.sampled.as_slice())
    {
        let side = match (person, sampled) {
            (true, _) => 0,
            (false, true) => 1,
            (false, false) => continue,
        };
        if met[side].is_multiple_of(step) {
            sides[side].push(color);
        }
        met[side] += 1;
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
        rayon::join(|| fit("person", person), || fit("background", background));
    Ok(ModelPair {
        person: person?,
        background: background?,
    })
}

/// What came of the cut of one view
struct ViewCut {
    mask: Mask,
    /// Undecided pixels whose colors contradict the mask
    doubts: Vec<(u32, u32)>,
}

fn cut_view(
    view: &SceneView,
    state: &ViewState,
    models: &ModelPair,
    plate: Option<&BackgroundPlate>,
    options: &SceneOptions,
) -> ViewCut {
    let attenuating = plate.filter(|_| options.attenuation);
    let seeds = state.narrowed.as_ref().unwrap_or(view.seeds);
    let mut band = BandCut::new(view.photo, seeds, options.smoothness, attenuating);
    if !band.undecided() {
        return ViewCut {
            mask: state.mask.clone(),
            doubts: Vec::new(),
        };
    }
    let colors: Vec<[u8; 3]> = band
        .pixels()
        .iter()
        .map(|&(x, y)| view.photo[(x as usize, y as usize)])
        .collect();
    let mut odds = vec![0.0; colors.len()];
    let mut background = vec![0.0; colors.len()];
    models.person.log_densities(&colors, &mut odds);
    models.background.log_densities(&colors, &mut background);
    for (node, (odds, background)) in odds.iter_mut().zip(&background).enumerate() {
        let (x, y) = band.pixels()[node];
        let (x, y) = (x as usize, y as usize);
        let background = match plate.and_then(|p| p.log_density(x, y, colors[node])) {
            Some(density) => log_sum_exp(
                PLATE_SHARE.ln() + density,
                (1.0 - PLATE_SHARE).ln() + background,
            ),
            None => *background,
        };
        *odds = (*odds - background).clamp(-options.color_limit, options.color_limit);
        *odds += view.prior.map_or(0.0, |prior| prior[(x, y)].value());
    }
    band.solve(&odds);
    let mask = clean(&band.mask(seeds), view.scale);
    let doubts = band.pixels().iter().zip(&odds).filter(|&(&(x, y), &odds)| {
        let person = mask[(x as usize, y as usize)];
        odds.abs() > DOUBT_ODDS && (odds > 0.0) != person
    });
    let doubts = doubts.map(|(&pixel, _)| pixel).collect();
    ViewCut { mask, doubts }
}

fn finish(
    view: &SceneView,
    state: ViewState,
    plate: Option<&BackgroundPlate>,
    options: &SceneOptions,
) -> SceneMask {
    let decided = !view.seeds.as_slice().iter().any(|seed| seed.undecided());
    if decided || !options.unmix_border {
        let soft = state.mask.map(|&v| if v { 1.0 } else { 0.0 });
        return SceneMask {
            mask: state.mask,
            soft,
        };
    }
    let mut soft = soft_border(view.photo, &state.mask, plate, view.scale);
    let mask = tidy_soft(&mut soft, view.scale);
    SceneMask { mask, soft }
}

#[cfg(test)]
mod tests;
