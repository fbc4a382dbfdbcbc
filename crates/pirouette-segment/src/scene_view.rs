//! One view of a scene.

use pirouette_geom::Grid;

use crate::seeds::{LogOdds, Seed};

/// A photo with prior knowledge per pixel
#[derive(Debug, Clone, Copy)]
pub struct SceneView<'a> {
    /// The photo
    pub photo: &'a Grid<[u8; 3]>,
    /// One per pixel; a view without undecided pixels only provides samples for the others
    pub seeds: &'a Grid<Seed>,
    /// Prior log odds, added to those of the colors; `None` is even odds everywhere
    pub prior: Option<&'a Grid<LogOdds>>,
    /// Height of the person in px over 800; scales all lengths in px
    pub scale: f64,
}
