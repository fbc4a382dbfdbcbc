//! What is known of each pixel before the segmentation.

use pirouette_geom::{Grid, Mask};

/// What is known of a pixel beforehand
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u8)]
pub enum Seed {
    /// Surely background; never changes
    #[default]
    Background,
    /// Undecided, background to begin with
    ProbableBackground,
    /// Undecided, person to begin with
    ProbablePerson,
    /// Surely person; never changes
    Person,
}

impl Seed {
    /// Whether the segmentation has to decide
    pub fn undecided(self) -> bool {
        matches!(self, Seed::ProbableBackground | Seed::ProbablePerson)
    }

    /// Whether it is person to begin with
    pub fn person(self) -> bool {
        matches!(self, Seed::ProbablePerson | Seed::Person)
    }
}

/// Logarithm of the odds that a pixel is person, known before its color is looked at, in one byte
///
/// 0 is even odds. Steps of 1/16; beyond +-7.9 it saturates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct LogOdds(i8);

impl LogOdds {
    /// Steps per unit
    const STEPS: f32 = 16.0;

    /// The nearest value there is; even odds for what is not a number
    pub fn new(log_odds: f32) -> Self {
        // a cast of a float cuts off, saturates and takes NaN to zero
        let steps = log_odds * Self::STEPS;
        Self((steps + 0.5_f32.copysign(steps)) as i8)
    }

    /// Natural logarithm of the odds
    pub fn value(self) -> f32 {
        f32::from(self.0) / Self::STEPS
    }
}

/// A part of the photo
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) x0: usize,
    pub(crate) y0: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl Window {
    /// The box of a mask, wider by `margin` px on every side as far as the mask's grid reaches
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

    /// Row `y` of the window in a grid of the whole photo
    pub(crate) fn row<'a, T>(&self, grid: &'a Grid<T>, y: usize) -> &'a [T] {
        &grid.row(self.y0 + y)[self.x0..self.x0 + self.width]
    }

    /// The same, to change it
    pub(crate) fn row_mut<'a, T>(&self, grid: &'a mut Grid<T>, y: usize) -> &'a mut [T] {
        &mut grid.row_mut(self.y0 + y)[self.x0..self.x0 + self.width]
    }

    /// Puts the window's values into a grid of the whole photo
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
