//! Prior knowledge per pixel.

use pirouette_geom::{Grid, Mask};

/// Prior label of a pixel
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u8)]
pub enum Seed {
    /// Definitely background; never changes
    #[default]
    Background,
    /// Undecided, initially background
    ProbableBackground,
    /// Undecided, initially person
    ProbablePerson,
    /// Definitely person; never changes
    Person,
}

impl Seed {
    /// Whether the segmentation decides the label
    pub fn undecided(self) -> bool {
        matches!(self, Seed::ProbableBackground | Seed::ProbablePerson)
    }

    /// Whether the initial label is person
    pub fn person(self) -> bool {
        matches!(self, Seed::ProbablePerson | Seed::Person)
    }
}

/// Natural logarithm of the prior odds that a pixel is person, in one byte
///
/// 0 is even odds. Resolution 1/16; saturates beyond +-7.9.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct LogOdds(i8);

impl LogOdds {
    /// Steps per unit
    const STEPS: f32 = 16.0;

    /// Rounds to the nearest representable value; NaN gives even odds
    pub fn new(log_odds: f32) -> Self {
        // a cast of a float truncates, saturates and maps NaN to zero
        let steps = log_odds * Self::STEPS;
        Self((steps + 0.5_f32.copysign(steps)) as i8)
    }

    /// Returns the natural logarithm of the odds
    pub fn value(self) -> f32 {
        f32::from(self.0) / Self::STEPS
    }
}

/// A rectangle of the photo
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) x0: usize,
    pub(crate) y0: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl Window {
    /// Returns the bounding box of a mask, extended by `margin` px on every side within the mask's grid
    pub(crate) fn around(mask: &Mask, margin: usize) -> Option<Self> {
        let (x0, y0, x1, y1) = mask.bounding_box()?;
        let (x0, y0) = (x0.saturating_sub(margin), y0.saturating_sub(margin));
        Some(Self {
            x0,
            y0,
            width: (x1 + margin).min(mask.width()) - x0,
            height: (y1 + margin).min(mask.height()) - y0,
        })
    }

    pub(crate) fn crop<T: Clone>(&self, grid: &Grid<T>) -> Grid<T> {
        grid.crop(self.x0, self.y0, self.width, self.height)
    }

    /// Returns row `y` of the window in a grid of the size of the photo
    pub(crate) fn row<'a, T>(&self, grid: &'a Grid<T>, y: usize) -> &'a [T] {
        &grid.row(self.y0 + y)[self.x0..self.x0 + self.width]
    }

    /// Like [`Self::row`], mutable
    pub(crate) fn row_mut<'a, T>(&self, grid: &'a mut Grid<T>, y: usize) -> &'a mut [T] {
        &mut grid.row_mut(self.y0 + y)[self.x0..self.x0 + self.width]
    }

    /// Writes the window's values into a grid of the size of the photo
    pub(crate) fn paste<T: Clone>(&self, part: &Grid<T>, grid: &mut Grid<T>) {
        for y in 0..self.height {
            self.row_mut(grid, y).clone_from_slice(part.row(y));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_odds_saturate_and_take_nan_as_even() {
        assert_eq!(LogOdds::new(2.5).value(), 2.5);
        assert!(LogOdds::new(99.0).value() > 7.9);
        assert!(LogOdds::new(-99.0).value() <= -7.9);
        assert_eq!(LogOdds::new(f32::NAN).value(), 0.0);
    }

    #[test]
    fn a_window_stops_at_the_border_and_pastes_back() {
        let mask = Mask::from_art("..... .#... .....");
        let window = Window::around(&mask, 1).unwrap();
        assert_eq!((window.x0, window.y0), (0, 0));
        assert_eq!((window.width, window.height), (3, 3));
        let mut out = Mask::filled(5, 3, false);
        window.paste(&window.crop(&mask), &mut out);
        assert_eq!(out, mask);
        assert_eq!(Window::around(&Mask::filled(2, 2, false), 1), None);
    }
}
