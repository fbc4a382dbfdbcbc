//! Search for the mannequin whose silhouettes overlap rough ones best.

use glam::{DVec2, DVec3};

use pirouette_body::mannequin::{MannequinError, MannequinParameters, coarse_mannequin};
use pirouette_body::render::SilhouetteMesh;
use pirouette_body::{
    Avatar, Bone, Camera, Joint, Keypoint, Keypoints, Pose, ReferencePose, Sex, TurnAngle,
    pose_bones,
};
use pirouette_geom::Mask;
use pirouette_geom::parallel::prelude::*;

/// A rough silhouette with the turn of the person
#[derive(Debug)]
pub(super) struct RoughView {
    pub(super) turn: TurnAngle,
    pub(super) mask: Mask,
    /// Number of pixels inside
    pub(super) area: usize,
}

/// Body mass indices of the mannequins that are tried, in kg/m²
const BODY_MASS_INDICES: [f64; 5] = [18.0, 22.0, 26.0, 31.0, 37.0];

/// Rotations of arms that are tried first, in degrees from the reference pose; positive raises
const ARM_ROTATIONS_DEGREES: [f64; 6] = [-36.0, -24.0, -12.0, 0.0, 12.0, 24.0];

/// Steps of the search: rotations of arms and legs in degrees, relative size
const STEPS: [(f64, f64); 4] = [(8.0, 0.02), (4.0, 0.01), (2.0, 0.005), (1.0, 0.0025)];

/// Steps of the search for the arms in single views, in degrees
const SWAY_STEPS_DEGREES: [f64; 3] = [16.0, 8.0, 4.0];

/// Maximum number of sweeps over all parameters with each step
const SWEEPS: usize = 2;

/// Largest rotations from the reference pose: arms and legs, in degrees
const MAX_ARM_DEGREES: f64 = 60.0;
const MAX_LEG_DEGREES: f64 = 12.0;

/// Standard deviation of an arm in single views around that in all views, in degrees
const SWAY_SIGMA_DEGREES: f64 = 9.0;

/// Pixels that a rotation by one standard deviation must gain at least
const SWAY_COST_PX: f64 = 10.0;

/// Largest relative change of size
const MAX_SIZE_CHANGE: f64 = 0.1;

/// Steps of the search for the shift of a silhouette, in px
const SHIFT_STEPS_PX: [isize; 4] = [8, 4, 2, 1];

/// Confidence of estimated joints
///
/// The skeleton fit assigns a standard deviation of 1 % of the stature to the trunk, the head and the legs, three times as
/// much to elbows and wrists, which bend and sway most.
fn confidence(joint: Joint) -> f64 {
    match joint {
        Joint::LeftElbow | Joint::RightElbow | Joint::LeftWrist | Joint::RightWrist => 0.1,
        _ => 0.3,
    }
}

/// Rotations of arms from the reference pose, in degrees: left and right raised, left and right swung forward; then the same
/// of the forearms
type Arms = [f64; 8];

/// Parameters of the figure besides its mass
#[derive(Debug, Clone, Copy, PartialEq)]
struct Posture {
    arms: Arms,
    /// Rotation of both legs outward, in degrees
    legs: f64,
    /// Size relative to that by the heights of the silhouettes
    size: f64,
}

impl Posture {
    const START: Posture = Posture {
        arms: [0.0; 8],
        legs: 0.0,
        size: 1.0,
    };

    /// Number of parameters that are common to all views; forearms bend in single views
    const COUNT: usize = 6;

    /// Returns the posture with parameter `index` changed by `steps` steps, within bounds
    fn changed(mut self, index: usize, steps: f64, (degrees, size): (f64, f64)) -> Self {
        let within = |value: f64, limit: f64| value.clamp(-limit, limit);
        match index {
            0..4 => {
                self.arms[index] = within(self.arms[index] + steps * degrees, MAX_ARM_DEGREES);
            }
            4 => self.legs = within(self.legs + steps * degrees, MAX_LEG_DEGREES),
            _ => self.size = 1.0 + within(self.size - 1.0 + steps * size, MAX_SIZE_CHANGE),
        }
        self
    }

    fn camera(&self, camera: &Camera) -> Camera {
        Camera {
            distance_mm: camera.distance_mm / self.size,
            ..*camera
        }
    }

    /// Returns the pose of a view, in which the arms deviate
    fn pose(&self, sway: &Arms) -> Pose {
        let arms: Arms = std::array::from_fn(|i| (self.arms[i] + sway[i]).to_radians());
        let legs = self.legs.to_radians();
        let mut pose = Pose::default();
        pose.rotations[Bone::LeftUpperArm] = DVec3::new(0.0, -arms[2], arms[0]);
        pose.rotations[Bone::RightUpperArm] = DVec3::new(0.0, arms[3], -arms[1]);
        pose.rotations[Bone::LeftForearm] = DVec3::new(0.0, -arms[6], arms[4]);
        pose.rotations[Bone::RightForearm] = DVec3::new(0.0, arms[7], -arms[5]);
        pose.rotations[Bone::LeftThigh] = DVec3::Z * legs;
        pose.rotations[Bone::RightThigh] = DVec3::Z * -legs;
        pose
    }
}

/// Place of a figure in one view
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Shift of the rendered silhouette, in px
    shift: (isize, isize),
    /// Deviation of the arms from the posture
    sway: Arms,
    /// Number of pixels that are inside one silhouette only
    differing: usize,
}

/// A figure with its place in each view
#[derive(Debug, Clone)]
struct Placed {
    posture: Posture,
    places: Vec<Place>,
}

impl Placed {
    /// Returns the number of pixels that are inside one silhouette only, over all views
    fn differing(&self) -> usize {
        self.places.iter().map(|place| place.differing).sum()
    }
}

/// A mannequin before the camera
struct Model {
    avatar: Avatar,
    mesh: SilhouetteMesh,
    camera: Camera,
}

/// A figure that overlaps rough silhouettes best
pub(super) struct Figure {
    model: Model,
    placed: Placed,
}

/// Finds the figure whose silhouettes overlap those of the views best; `camera` has the size of the silhouettes
///
/// The distance of the camera follows from the heights of the silhouettes. After `cancelled` returns true, the search ends
/// with what was found so far.
///
/// # Errors
/// When there is no mannequin of that stature.
pub(super) fn find_figure(
    views: &[RoughView],
    pose: ReferencePose,
    stature_mm: f64,
    camera: &Camera,
    cancelled: &(dyn Fn() -> bool + Sync),
) -> Result<Figure, MannequinError> {
    let of = |index: f64| {
        let avatar = coarse_mannequin(&MannequinParameters {
            sex: Sex::Neutral,
            mass_kg: Some(index * (stature_mm / 1000.0).powi(2)),
            stature_mm: Some(stature_mm),
            pose,
            ..MannequinParameters::default()
        })?;
        let model = Model::new(avatar, camera, views);
        let placed = model.start(views);
        Ok(Figure { model, placed })
    };
    let [first, others @ ..] = BODY_MASS_INDICES;
    let mut best = of(first)?;
    for index in others {
        if cancelled() {
            break;
        }
        let tried = of(index)?;
        if tried.placed.differing() < best.placed.differing() {
            best = tried;
        }
    }
    let Figure { model, placed } = best;
    let placed = model.refine(views, placed, &STEPS, cancelled);
    Ok(Figure { model, placed })
}

impl Figure {
    /// Refines the figure on other silhouettes of the same views
    pub(super) fn refined(
        self,
        views: &[RoughView],
        cancelled: &(dyn Fn() -> bool + Sync),
    ) -> Self {
        let Self { model, placed } = self;
        let placed = model.place(views, placed.posture, Some(&placed));
        let placed = model.refine(views, placed, &STEPS[1..], cancelled);
        let placed = model.sway(views, placed, cancelled);
        Self { model, placed }
    }

    /// Returns the intersection over union of the silhouettes of the figure and of the views, over all views
    pub(super) fn overlap(&self, views: &[RoughView]) -> f64 {
        let seen: usize = views.iter().map(|view| view.area).sum();
        let own: usize = self.silhouettes(views).iter().map(Mask::area).sum();
        let (sum, differing) = ((seen + own) as f64, self.placed.differing() as f64);
        (sum - differing) / (sum + differing)
    }

    /// Renders the silhouette of the figure in each view
    pub(super) fn silhouettes(&self, views: &[RoughView]) -> Vec<Mask> {
        let Self { model, placed } = self;
        let views = views.par_iter().zip(&placed.places);
        views
            .map(|(view, place)| {
                let rendered = model.render(view, &placed.posture, &place.sway);
                let (right, down) = place.shift;
                Mask::from_fn(rendered.width(), rendered.height(), |x, y| {
                    let inside = rendered.get(x as isize - right, y as isize - down);
                    inside.is_some_and(|&inside| inside)
                })
            })
            .collect()
    }

    /// Returns the joints in each view, in px of the silhouettes
    pub(super) fn joints(&self, views: &[RoughView]) -> Vec<Keypoints> {
        let Self { model, placed } = self;
        let avatar = &model.avatar;
        let camera = placed.posture.camera(&model.camera);
        let views = views.iter().zip(&placed.places);
        views
            .map(|(view, place)| {
                let pose = placed.posture.pose(&place.sway);
                let posed = pose_bones(&avatar.bone_heads, &pose, view.turn);
                let joints = posed.keypoints(&avatar.keypoints);
                let shift = DVec2::new(place.shift.0 as f64, place.shift.1 as f64);
                let keypoint = |joint: Joint| Keypoint {
                    position: camera.project(joints[joint]) + shift,
                    confidence: confidence(joint),
                };
                let all = Joint::ALL.iter();
                all.map(|&joint| (joint, keypoint(joint))).collect()
            })
            .collect()
    }
}

impl Model {
    fn new(avatar: Avatar, camera: &Camera, views: &[RoughView]) -> Self {
        let mesh = SilhouetteMesh::new(&avatar.mesh.triangles);
        let mut model = Self {
            avatar,
            mesh,
            camera: *camera,
        };
        let heights = views.iter().filter_map(|view| height_px(&view.mask));
        let Some(seen_px) = median(heights.collect()) else {
            return model;
        };
        model.camera.distance_mm = camera.focal_px() * model.avatar.stature_mm() / seen_px;
        // The feet are nearer to the camera, or farther away, than the turning axis.
        let rendered = views
            .iter()
            .filter_map(|view| height_px(&model.render(view, &Posture::START, &Arms::default())));
        if let Some(rendered_px) = median(rendered.collect()) {
            model.camera.distance_mm *= rendered_px / seen_px;
        }
        model
    }

    fn render(&self, view: &RoughView, posture: &Posture, sway: &Arms) -> Mask {
        let positions = self.avatar.posed(&posture.pose(sway), view.turn).positions;
        let camera = posture.camera(&self.camera);
        self.mesh.silhouette(&positions, &camera).threshold(0.5)
    }

    /// Places the model with each of the first rotations of the arms; returns the best
    fn start(&self, views: &[RoughView]) -> Placed {
        let tried = ARM_ROTATIONS_DEGREES.map(|degrees| {
            let posture = Posture {
                arms: [degrees, degrees, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                ..Posture::START
            };
            self.place(views, posture, None)
        });
        let best = tried.into_iter().min_by_key(Placed::differing);
        best.unwrap_or_else(|| self.place(views, Posture::START, None))
    }

    /// Places a posture in all views, near an earlier place if there is one
    fn place(&self, views: &[RoughView], posture: Posture, near: Option<&Placed>) -> Placed {
        let place = |(index, view): (usize, &RoughView)| match near {
            Some(near) => self.place_in(view, &posture, &near.places[index]),
            None => {
                let sway = Arms::default();
                let rendered = self.render(view, &posture, &sway);
                let start = middle_shift(&rendered, &view.mask);
                let (shift, differing) = best_shift(&rendered, view, start, &SHIFT_STEPS_PX);
                Place {
                    shift,
                    sway,
                    differing,
                }
            }
        };
        Placed {
            posture,
            places: views.par_iter().enumerate().map(place).collect(),
        }
    }

    /// Places a posture in one view, near an earlier place
    fn place_in(&self, view: &RoughView, posture: &Posture, near: &Place) -> Place {
        let rendered = self.render(view, posture, &near.sway);
        let (shift, differing) = best_shift(&rendered, view, near.shift, &SHIFT_STEPS_PX[2..]);
        Place {
            shift,
            differing,
            ..*near
        }
    }

    /// Improves the parameters one by one, with decreasing steps
    fn refine(
        &self,
        views: &[RoughView],
        mut best: Placed,
        steps: &[(f64, f64)],
        cancelled: &(dyn Fn() -> bool + Sync),
    ) -> Placed {
        for &step in steps {
            for _ in 0..SWEEPS {
                let before = best.differing();
                for (index, direction) in both_directions(Posture::COUNT) {
                    if cancelled() {
                        return best;
                    }
                    let posture = best.posture.changed(index, direction, step);
                    let tried = self.place(views, posture, Some(&best));
                    if tried.differing() < best.differing() {
                        best = tried;
                    }
                }
                if best.differing() == before {
                    break;
                }
            }
        }
        best
    }

    /// Improves the arms in each view by itself
    fn sway(
        &self,
        views: &[RoughView],
        placed: Placed,
        cancelled: &(dyn Fn() -> bool + Sync),
    ) -> Placed {
        let Placed { posture, places } = placed;
        let cost = |place: &Place| {
            let sigmas = place.sway.map(|degrees| degrees / SWAY_SIGMA_DEGREES);
            let squares: f64 = sigmas.iter().map(|s| s * s).sum();
            place.differing as f64 + SWAY_COST_PX * squares
        };
        let improve = |(view, mut best): (&RoughView, Place)| {
            for degrees in SWAY_STEPS_DEGREES {
                for _ in 0..SWEEPS {
                    let before = cost(&best);
                    for (index, direction) in both_directions(best.sway.len()) {
                        if cancelled() {
                            return best;
                        }
                        let mut near = best;
                        near.sway[index] += direction * degrees;
                        let tried = self.place_in(view, &posture, &near);
                        if cost(&tried) < cost(&best) {
                            best = tried;
                        }
                    }
                    if cost(&best) >= before {
                        break;
                    }
                }
            }
            best
        };
        Placed {
            posture,
            places: views.par_iter().zip(places).map(improve).collect(),
        }
    }
}

/// Returns each of `count` indices, downward and upward
fn both_directions(count: usize) -> impl Iterator<Item = (usize, f64)> {
    (0..count).flat_map(|index| [(index, -1.0), (index, 1.0)])
}

fn height_px(mask: &Mask) -> Option<f64> {
    let (_, top, _, bottom) = mask.bounding_box()?;
    Some((bottom - top) as f64)
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    crate::check::median(&mut values)
}

/// Returns the shift between the centers of two silhouettes: center of mass across, middle of the box down
fn middle_shift(rendered: &Mask, seen: &Mask) -> (isize, isize) {
    let middle = |mask: &Mask| {
        let (_, top, _, bottom) = mask.bounding_box()?;
        let (mut sum, mut count) = (0, 0);
        for y in top..bottom {
            for (x, _) in mask
                .row(y)
                .iter()
                .enumerate()
                .filter(|(_, inside)| **inside)
            {
                sum += x;
                count += 1;
            }
        }
        Some(((sum / count.max(1)) as isize, ((top + bottom) / 2) as isize))
    };
    match (middle(rendered), middle(seen)) {
        (Some(from), Some(to)) => (to.0 - from.0, to.1 - from.1),
        _ => (0, 0),
    }
}

/// Searches the shift of a rendered silhouette with the fewest differing pixels; returns it with their number
fn best_shift(
    rendered: &Mask,
    view: &RoughView,
    start: (isize, isize),
    steps: &[isize],
) -> ((isize, isize), usize) {
    let Some(bounds) = rendered.bounding_box() else {
        return (start, view.area);
    };
    let sum = rendered.area() + view.area;
    let differing = |shift| sum - 2 * overlap(rendered, bounds, &view.mask, shift);
    let mut best = (start, differing(start));
    for &step in steps {
        loop {
            let (right, down) = best.0;
            let around = [(-step, 0), (step, 0), (0, -step), (0, step)];
            let tried = around.map(|(x, y)| (right + x, down + y));
            let tried = tried.map(|shift| (shift, differing(shift)));
            match tried.into_iter().min_by_key(|(_, differing)| *differing) {
                Some(better) if better.1 < best.1 => best = better,
                _ => break,
            }
        }
    }
    best
}

/// Returns the number of pixels inside both masks, one of them shifted
pub(super) fn overlap(
    shifted: &Mask,
    (x0, y0, x1, y1): (usize, usize, usize, usize),
    mask: &Mask,
    (right, down): (isize, isize),
) -> usize {
    let from = (x0 as isize + right).clamp(0, mask.width() as isize);
    let to = (x1 as isize + right).clamp(from, mask.width() as isize);
    let Some(first) = (from < to).then(|| (from - right) as usize) else {
        return 0;
    };
    let mut count = 0;
    for y in y0..y1 {
        let Ok(target) = usize::try_from(y as isize + down) else {
            continue;
        };
        if target >= mask.height() {
            break;
        }
        let seen = &mask.row(target)[from as usize..to as usize];
        let both = seen.iter().zip(&shifted.row(y)[first..]);
        count += both.filter(|(a, b)| **a && **b).count();
    }
    count
}
