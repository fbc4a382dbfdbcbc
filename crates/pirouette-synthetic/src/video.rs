//! Videos of rendered people who turn: the turn varies in speed, the sway is smooth, fast parts are blurred.

use std::f64::consts::TAU;
use std::ops::ControlFlow;

use pirouette::scan::Photo;
use pirouette_body::{Avatar, Camera, Pose, TurnAngle};
use pirouette_geom::Grid;
use pirouette_geom::parallel::prelude::*;

use super::{Appearance, Clutter, Random, expose, person, room, sway};

/// Options of [`render_video`]
#[derive(Debug, Clone, PartialEq)]
pub struct VideoOptions {
    /// Seed of the person's look, the room, the sway and the turn
    pub seed: u64,
    /// The camera; its size is that of the frames
    pub camera: Camera,
    /// Sway relative to that of people who try to stand still
    pub sway: f64,
    /// Standard deviation of sensor noise, in levels
    pub sensor_noise: f64,
    /// What stands in the room
    pub clutter: Clutter,
    /// Frames per second
    pub frames_per_s: f64,
    /// The turn
    pub turn: TurnCourse,
}

/// The course of a turn: the person comes, stands, turns at a changing speed, perhaps pauses, and stands again
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurnCourse {
    /// Time in which the person comes from beside the picture, in s; 0 is there at once
    pub enter_s: f64,
    /// Angle at the start, in radians
    pub start_radians: f64,
    /// Angle of the complete turn, in radians; negative turns the other way
    pub turned_radians: f64,
    /// Duration of the turn without the pause, in s
    pub turn_s: f64,
    /// Time before and after the turn, in s
    pub still_s: f64,
    /// Relative change of the speed, below 1; its course repeats three times in the turn
    pub speed_change: f64,
    /// Duration of a pause in the middle of the turn, in s
    pub pause_s: f64,
}

impl TurnCourse {
    /// Returns the duration, in s
    pub fn duration_s(&self) -> f64 {
        self.enter_s + 2.0 * self.still_s + self.turn_s + self.pause_s
    }

    /// Returns the distance of the person from the turning axis, from 1 at the start to 0
    fn aside(&self, time_s: f64) -> f64 {
        (1.0 - time_s / self.enter_s.max(f64::MIN_POSITIVE)).max(0.0)
    }

    /// Returns the turn angle at a time, in radians
    pub fn angle_at(&self, time_s: f64) -> f64 {
        let turning_s = time_s - self.enter_s - self.still_s;
        let half_s = self.turn_s / 2.0;
        let turned_s = turning_s.min(half_s) + (turning_s - half_s - self.pause_s).max(0.0);
        let share = (turned_s / self.turn_s).clamp(0.0, 1.0);
        let wave = 3.0 * TAU;
        // The integral of 1 - change * cos: no change after a complete turn.
        let share = share - self.speed_change * (wave * share).sin() / wave;
        self.start_radians + share * self.turned_radians
    }
}

/// Time between independent poses, between which the sway is interpolated, in s
const SWAY_S: f64 = 1.6;

/// Distance from which the person comes, in statures: outside of upright pictures
const ENTRY_STATURES: f64 = 1.0;

/// Share of the time between frames in which the shutter is open
const SHUTTER: f64 = 0.5;

/// Motion of the outermost points within an exposure, in px, from which on a frame is blurred
const BLURRED_PX: f64 = 0.7;

/// Number of moments that are averaged in a blurred frame
const MOMENTS: usize = 4;

/// Renders a video frame by frame; `on_frame` gets the number of the frame, in order, and the picture
///
/// Returns the true angle of each frame, in radians: that of the swaying person's hips.
pub fn render_video(
    avatar: &Avatar,
    options: &VideoOptions,
    on_frame: &mut dyn FnMut(usize, Photo) -> ControlFlow<()>,
) -> Vec<f64> {
    const BATCH: usize = 16;
    let camera = options.camera;
    let look = person::Look::new(avatar, options.seed, &Appearance::default());
    let background = room::Room::new(options.seed, options.clutter).render(&camera);
    let motion = Motion::new(options);
    let count = (options.turn.duration_s() * options.frames_per_s).floor() as usize;
    let frame = |index: usize| {
        let time_s = index as f64 / options.frames_per_s;
        let light = |time_s: f64| {
            let (pose, turn) = motion.at(avatar, time_s);
            look.paint(&background, &avatar.posed(&pose, turn).positions, &camera)
        };
        let open_s = SHUTTER / options.frames_per_s;
        let moved_radians = options.turn.angle_at(time_s + open_s) - options.turn.angle_at(time_s);
        let reach_px = 0.25 * avatar.stature_mm() * camera.focal_px() / camera.distance_mm;
        let exposed = if moved_radians.abs() * reach_px < BLURRED_PX {
            light(time_s)
        } else {
            let moments = (0..MOMENTS)
                .map(|i| light(time_s + open_s * ((i as f64 + 0.5) / MOMENTS as f64 - 0.5)));
            mean(moments)
        };
        let seed = options.seed ^ (index as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        expose(&exposed, options.sensor_noise, &mut Random::new(seed))
    };
    let mut angles = Vec::with_capacity(count);
    for start in (0..count).step_by(BATCH) {
        let indices: Vec<usize> = (start..count.min(start + BATCH)).collect();
        let photos: Vec<Photo> = indices.par_iter().map(|&index| frame(index)).collect();
        for (index, photo) in indices.into_iter().zip(photos) {
            let (pose, turn) = motion.at(avatar, index as f64 / options.frames_per_s);
            angles.push(turn.radians() + pose.turned_more().radians());
            if on_frame(index, photo).is_break() {
                return angles;
            }
        }
    }
    angles
}

/// Averages the light of several moments
fn mean(moments: impl Iterator<Item = Grid<[f32; 3]>>) -> Grid<[f32; 3]> {
    let mut count = 0.0_f32;
    let sum = moments.inspect(|_| count += 1.0).reduce(|mut sum, light| {
        for (sum, light) in sum.as_mut_slice().iter_mut().zip(light.as_slice()) {
            for (sum, light) in sum.iter_mut().zip(light) {
                *sum += light;
            }
        }
        sum
    });
    let sum = sum.unwrap_or_else(|| Grid::filled(0, 0, [0.0; 3]));
    sum.map(|light| light.map(|v| v / count.max(1.0)))
}

/// Poses over time
struct Motion {
    turn: TurnCourse,
    /// Parameters of independent poses, at multiples of [`SWAY_S`] from one before the start on
    poses: Vec<Vec<f64>>,
    /// Displacements of the center of mass, likewise
    off_mm: Vec<glam::DVec2>,
}

impl Motion {
    fn new(options: &VideoOptions) -> Self {
        let random = &mut Random::new(options.seed ^ 0x5eed);
        let count = (options.turn.duration_s() / SWAY_S).ceil() as usize + 4;
        let poses = (0..count)
            .map(|_| {
                sway::sway(0.0, options.sway, random)
                    .to_parameters()
                    .to_vec()
            })
            .collect();
        let off_mm = (0..count)
            .map(|_| sway::off_balance_mm(options.sway, random))
            .collect();
        Self {
            turn: options.turn,
            poses,
            off_mm,
        }
    }

    /// Returns pose and turn at a time: a cubic B-spline through the independent poses
    fn at(&self, avatar: &Avatar, time_s: f64) -> (Pose, TurnAngle) {
        let along = (time_s / SWAY_S).max(0.0);
        let first = (along.floor() as usize).min(self.poses.len() - 4);
        let t = along - first as f64;
        let weights = [
            (1.0 - t).powi(3) / 6.0,
            (3.0 * t.powi(3) - 6.0 * t * t + 4.0) / 6.0,
            (-3.0 * t.powi(3) + 3.0 * t * t + 3.0 * t + 1.0) / 6.0,
            t.powi(3) / 6.0,
        ];
        // Averages of independent values vary less: by the root of the mean of the sums of squared weights.
        const GAIN: f64 = 1.44;
        let blend = |of: &dyn Fn(usize) -> f64| -> f64 {
            GAIN * (0..4).map(|k| weights[k] * of(first + k)).sum::<f64>()
        };
        let parameters = std::array::from_fn(|i| blend(&|k| self.poses[k][i]));
        let mut pose = Pose::from_parameters(&parameters);
        let off_mm = glam::DVec2::new(blend(&|k| self.off_mm[k].x), blend(&|k| self.off_mm[k].y));
        let turn = TurnAngle::from_radians(self.turn.angle_at(time_s));
        sway::stand(avatar, turn, off_mm, &mut pose);
        pose.shift_mm.x += self.turn.aside(time_s) * ENTRY_STATURES * avatar.stature_mm();
        (pose, turn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SyntheticOptions;
    use pirouette_body::mannequin::{MannequinParameters, mannequin};

    const COURSE: TurnCourse = TurnCourse {
        enter_s: 0.0,
        start_radians: 0.5,
        turned_radians: -TAU,
        turn_s: 10.0,
        still_s: 1.0,
        speed_change: 0.4,
        pause_s: 2.0,
    };

    #[test]
    fn a_course_stands_turns_pauses_and_stands() {
        let angle = |time_s| COURSE.angle_at(time_s);
        assert_eq!(COURSE.duration_s(), 14.0);
        assert_eq!((angle(0.0), angle(1.0)), (0.5, 0.5));
        assert!((angle(6.0) - (0.5 - TAU / 2.0)).abs() < 1e-9);
        assert_eq!(angle(6.0), angle(8.0));
        assert!((angle(13.0) - (0.5 - TAU)).abs() < 1e-9);
        assert_eq!(angle(13.0), angle(14.0));
        let speeds: Vec<f64> = (10..60)
            .map(|i| angle(i as f64 / 10.0) - angle(i as f64 / 10.0 + 0.1))
            .collect();
        let [slow, fast] = [f64::min, f64::max].map(|f| speeds.iter().copied().reduce(f).unwrap());
        assert!((fast / slow - 1.4 / 0.6).abs() < 0.1, "{slow} to {fast}");
    }

    #[test]
    fn frames_are_in_order_and_differ_little_from_their_neighbors() {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        let options = VideoOptions {
            seed: 5,
            camera: SyntheticOptions::camera_for(avatar.stature_mm(), 90, 160),
            sway: 1.0,
            sensor_noise: 0.0,
            clutter: Clutter::default(),
            frames_per_s: 30.0,
            turn: TurnCourse {
                turn_s: 1.0,
                still_s: 0.0,
                pause_s: 0.0,
                ..COURSE
            },
        };
        let mut photos: Vec<Photo> = Vec::new();
        let angles = render_video(&avatar, &options, &mut |index, photo| {
            assert_eq!(index, photos.len());
            photos.push(photo);
            if index == 20 {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        assert_eq!((angles.len(), photos.len()), (21, 21));
        let changed = |a: &Photo, b: &Photo| {
            let pairs = a.as_slice().iter().zip(b.as_slice());
            pairs.filter(|(a, b)| a[1].abs_diff(b[1]) > 20).count()
        };
        let near = changed(&photos[3], &photos[4]);
        let far = changed(&photos[3], &photos[12]);
        assert!(near > 0 && 2 * near < far, "{near} of {far}");
    }
}
