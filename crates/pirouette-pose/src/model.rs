//! Detection of a person's landmarks in a photo

use crate::crop::Pyramid;
use crate::graph::{Graph, Memory, Schedule};
use crate::kernels::Shape;
use crate::kernels::elementwise::logistic;
use crate::landmarks::{LANDMARK_COUNT, NETWORK_LANDMARKS, VALUES, decode};
use crate::{Landmark, ModelError, Photo, Region};
use std::sync::Mutex;

/// Places of the outputs in the file
const LANDMARKS: usize = 0;
const PRESENCE: usize = 1;
const MASK: usize = 2;
const HEAT_MAPS: usize = 3;

/// Network that finds the landmarks of one person in a region of a photo
///
/// Can be used from several threads at once. Each call uses its own memory, which is kept for later calls: for the
/// `full` model 7 MB, with mask 9 MB, per simultaneous call.
#[derive(Debug)]
pub struct PoseModel {
    graph: Graph,
    without_mask: Task,
    with_mask: Task,
    side: usize,
    heat_shape: Shape,
    mask_shape: Shape,
}

/// Outputs to compute, as numbers of values, and how
#[derive(Debug)]
struct Task {
    outputs: Vec<usize>,
    schedule: Schedule,
    /// Memory of finished calls: obtaining it from the system again takes a fifth of the time of a pass
    free: Mutex<Vec<Memory>>,
}

impl Task {
    fn new(graph: &Graph, outputs: Vec<usize>) -> Result<Self, ModelError> {
        Ok(Self {
            schedule: Schedule::new(graph, &outputs)?,
            outputs,
            free: Mutex::default(),
        })
    }

    /// Takes memory of a finished call, or allocates it.
    fn take_memory(&self) -> Memory {
        let free = self.free.lock().ok().and_then(|mut free| free.pop());
        free.unwrap_or_else(|| self.schedule.memory())
    }
}

/// Result of [`PoseModel::detect`]
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Detection {
    /// Points of the body, in the order documented at [`Landmark`]
    pub landmarks: [Landmark; LANDMARK_COUNT],
    /// Estimated probability that there is a person in the region, 0 to 1
    pub presence: f64,
    /// Region in which the landmarks were found
    pub region: Region,
    /// Region of the same person derived from the landmarks, for another pass or the next photo; equal to `region` if
    /// the network's values are not finite
    pub next_region: Region,
    /// Probability of each pixel of the region to show the person, if requested
    pub mask: Option<PersonMask>,
}

/// Probability that pixels show the person, inside a region
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PersonMask {
    /// Region that the mask covers
    pub region: Region,
    /// Number of columns
    pub width: usize,
    /// Number of rows
    pub height: usize,
    /// Probabilities, 0 to 1, row by row from the top left of the region
    pub values: Vec<f32>,
}

impl PersonMask {
    /// Interpolates the probability at a position in px of the photo, (0.5, 0.5) being the center of the top left
    /// pixel; 0 outside the region.
    pub fn at(&self, position: [f64; 2]) -> f64 {
        let is_inside = |v: f64| (0.0..=1.0).contains(&v);
        if !self
            .region
            .unit_from_photo(position)
            .into_iter()
            .all(is_inside)
            || self.values.is_empty()
        {
            return 0.0;
        }
        // Regions are sampled relative to pixel centers.
        let [x, y] = self.region.unit_from_photo(position.map(|v| v - 0.5));
        let (left, right, fx) = neighbors(x, self.width);
        let (top, bottom, fy) = neighbors(y, self.height);
        let value = |column, row| {
            self.values
                .get(row * self.width + column)
                .map_or(0.0, |&v| f64::from(v))
        };
        let above = value(left, top) * (1.0 - fx) + value(right, top) * fx;
        let below = value(left, bottom) * (1.0 - fx) + value(right, bottom) * fx;
        above * (1.0 - fy) + below * fy
    }
}

/// Returns the indices on both sides of a position, 0 to 1, and the weight of the second.
fn neighbors(unit: f64, count: usize) -> (usize, usize, f64) {
    let last = count.saturating_sub(1);
    let at = (unit * count as f64).clamp(0.0, last as f64);
    (at as usize, (at as usize + 1).min(last), at.fract())
}

impl PoseModel {
    /// Reads the contents of a file `pose_landmark_lite.tflite`, `pose_landmark_full.tflite` or
    /// `pose_landmark_heavy.tflite` of MediaPipe.
    ///
    /// # Errors
    /// If the file is damaged, is not such a model, or exceeds limits of size. All of it is checked here: detection
    /// cannot fail.
    pub fn parse(bytes: &[u8]) -> Result<Self, ModelError> {
        let graph = Graph::parse(bytes)?;
        let input = graph.values[0];
        if input.channels != 3 || input.width != input.height {
            return Err(wrong("the input", Some(input), "[1, n, n, 3]"));
        }
        let is_vector = |len: usize| {
            move |s: Shape| {
                s == Shape {
                    height: 1,
                    width: 1,
                    channels: len,
                }
            }
        };
        let landmarks = output(
            &graph,
            LANDMARKS,
            "output 0, the landmarks,",
            "[1, 195]",
            is_vector(NETWORK_LANDMARKS * VALUES),
        )?;
        let presence = output(
            &graph,
            PRESENCE,
            "output 1, the presence,",
            "[1, 1]",
            is_vector(1),
        )?;
        let mask = output(
            &graph,
            MASK,
            "output 2, the mask,",
            "[1, height, width, 1]",
            |s| s.channels == 1,
        )?;
        let heat = output(
            &graph,
            HEAT_MAPS,
            "output 3, the heat maps,",
            "[1, height, width, 39]",
            |s| s.channels == NETWORK_LANDMARKS,
        )?;
        Ok(Self {
            without_mask: Task::new(&graph, vec![landmarks, presence, heat])?,
            with_mask: Task::new(&graph, vec![landmarks, presence, heat, mask])?,
            side: input.width,
            heat_shape: graph.values[heat],
            mask_shape: graph.values[mask],
            graph,
        })
    }

    /// Finds the landmarks of the person in a region.
    ///
    /// Each of the `passes` (at least one is run) uses the region that results from the pass before. Two are sufficient
    /// after [`Self::search`] and for a region known from another photo. Always returns landmarks; check
    /// [`Detection::presence`], and the visibility of each.
    pub fn detect(
        &self,
        photo: &Photo,
        region: &Region,
        passes: usize,
        want_mask: bool,
    ) -> Detection {
        let mut runner = Runner::new(self, *photo, want_mask);
        let mut region = *region;
        for _ in 1..passes {
            region = runner.run(&region).next_region;
        }
        let mut detection = runner.run(&region);
        detection.mask = want_mask.then(|| runner.mask(&region));
        detection
    }
}

/// Error for an input or output of another shape
fn wrong(what: &'static str, found: Option<Shape>, expected: &'static str) -> ModelError {
    ModelError::WrongInterface {
        what,
        found: found.map_or(Vec::new(), |s| s.sizes().to_vec()),
        expected,
    }
}

/// Returns the value of an output if its shape is accepted.
fn output(
    graph: &Graph,
    index: usize,
    what: &'static str,
    expected: &'static str,
    accepts: impl Fn(Shape) -> bool,
) -> Result<usize, ModelError> {
    let value = graph
        .outputs
        .get(index)
        .copied()
        .ok_or(wrong(what, None, expected))?;
    let shape = graph.values[value];
    if accepts(shape) {
        Ok(value)
    } else {
        Err(wrong(what, Some(shape), expected))
    }
}

/// Photo and memory of one call
#[derive(Debug)]
pub(crate) struct Runner<'a> {
    model: &'a PoseModel,
    task: &'a Task,
    pyramid: Pyramid<'a>,
    memory: Memory,
}

impl<'a> Runner<'a> {
    pub(crate) fn new(model: &'a PoseModel, photo: Photo<'a>, want_mask: bool) -> Self {
        let task = if want_mask {
            &model.with_mask
        } else {
            &model.without_mask
        };
        Self {
            model,
            task,
            pyramid: Pyramid::new(photo),
            memory: task.take_memory(),
        }
    }

    pub(crate) fn photo(&self) -> &Photo<'a> {
        self.pyramid.photo()
    }

    /// Runs the network on a region; the mask is not decoded.
    pub(crate) fn run(&mut self, region: &Region) -> Detection {
        let (graph, side) = (&self.model.graph, self.model.side);
        self.pyramid.sample(
            region,
            side,
            self.task.schedule.input(graph, &mut self.memory),
        );
        self.task.schedule.run(graph, &mut self.memory);
        let decoded = decode(
            self.output(0),
            self.output(2),
            self.model.heat_shape,
            side,
            region,
        );
        Detection {
            landmarks: decoded.landmarks,
            presence: f64::from(self.output(1)[0]),
            region: *region,
            next_region: decoded.next_region.unwrap_or(*region),
            mask: None,
        }
    }

    fn output(&self, which: usize) -> &[f32] {
        self.task
            .schedule
            .output(&self.model.graph, &self.task.outputs, which, &self.memory)
    }

    /// Decodes the mask of the last run.
    fn mask(&self, region: &Region) -> PersonMask {
        let Shape { width, height, .. } = self.model.mask_shape;
        PersonMask {
            region: *region,
            width,
            height,
            values: self.output(3).iter().map(|&v| logistic(v)).collect(),
        }
    }
}

impl Drop for Runner<'_> {
    fn drop(&mut self) {
        if let Ok(mut free) = self.task.free.lock() {
            free.push(std::mem::take(&mut self.memory));
        }
    }
}

#[cfg(test)]
mod tflite_vectors;

#[cfg(test)]
mod tests {
    use super::PersonMask;
    use crate::Region;

    #[test]
    fn mask_interpolates_between_pixel_centers() {
        let region = Region::new([1.0, 1.0], 2.0, 0.0).unwrap();
        let mask = PersonMask {
            region,
            width: 2,
            height: 2,
            values: vec![0.0, 1.0, 0.5, 0.25],
        };
        for (position, expected) in [
            ([0.5, 0.5], 0.0),
            ([1.5, 0.5], 1.0),
            ([1.5, 1.5], 0.25),
            ([1.0, 0.5], 0.5),
            ([0.1, 1.9], 0.5),
        ] {
            assert!((mask.at(position) - expected).abs() < 1e-12, "{position:?}");
        }
        for position in [
            [-0.1, 0.5],
            [0.5, 2.1],
            [f64::NAN, 0.5],
            [f64::INFINITY, 0.5],
        ] {
            assert_eq!(mask.at(position), 0.0);
        }
    }
}
