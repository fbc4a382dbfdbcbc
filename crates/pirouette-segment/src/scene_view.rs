//! One view of a scene.

use pirouette_geom::Grid;

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
