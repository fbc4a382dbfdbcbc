//! Rasters: a row-major grid of values, and the binary mask.

use std::fmt;

/// A row-major raster of `width` x `height` values
///
/// Pixel `(x, y)` covers the square from `(x, y)` to `(x + 1, y + 1)`; its center is at `.5`.
#[derive(Clone, PartialEq, Eq)]
pub struct Grid<T> {
    width: usize,
    height: usize,
    data: Vec<T>,
}

/// A binary raster; `true` is inside
pub type Mask = Grid<bool>;

impl<T> Grid<T> {
    /// Wraps row-major `data`
    ///
    /// # Panics
    /// When `data` does not hold `width * height` values.
    pub fn from_vec(width: usize, height: usize, data: Vec<T>) -> Self {
        assert_eq!(
            data.len(),
            width * height,
            "a {width} x {height} grid needs as many values"
        );
        Self {
            width,
            height,
            data,
        }
    }

    /// Computes every value from its column and row
    pub fn from_fn(width: usize, height: usize, mut value: impl FnMut(usize, usize) -> T) -> Self {
        let mut data = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                data.push(value(x, y));
            }
        }
        Self {
            width,
            height,
            data,
        }
    }

    /// Returns the number of columns
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of rows
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns all values, row by row
    pub fn as_slice(&self) -> &[T] {
        &self.data
    }

    /// Returns all values, row by row
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// Returns the row-major values
    pub fn into_vec(self) -> Vec<T> {
        self.data
    }

    /// Returns one row
    ///
    /// # Panics
    /// When `y` is not below the height.
    pub fn row(&self, y: usize) -> &[T] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// Returns one row
    ///
    /// # Panics
    /// When `y` is not below the height.
    pub fn row_mut(&mut self, y: usize) -> &mut [T] {
        &mut self.data[y * self.width..(y + 1) * self.width]
    }

    /// Returns the value at a pixel, `None` outside; takes signed coordinates, which simplifies access to neighbors
    pub fn get(&self, x: isize, y: isize) -> Option<&T> {
        let inside = x >= 0 && y >= 0 && (x as usize) < self.width && (y as usize) < self.height;
        inside.then(|| &self.data[y as usize * self.width + x as usize])
    }

    /// Returns a grid of the same size with every value mapped
    pub fn map<U>(&self, value: impl FnMut(&T) -> U) -> Grid<U> {
        Grid {
            width: self.width,
            height: self.height,
            data: self.data.iter().map(value).collect(),
        }
    }

    /// Whether another grid has the same width and height
    pub fn same_size<U>(&self, other: &Grid<U>) -> bool {
        self.width == other.width && self.height == other.height
    }
}

impl<T: Clone> Grid<T> {
    /// Creates a grid of one value
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self {
            width,
            height,
            data: vec![value; width * height],
        }
    }

    /// Returns the part that starts at column `x0` and row `y0`
    ///
    /// # Panics
    /// When the part reaches beyond the grid.
    pub fn crop(&self, x0: usize, y0: usize, width: usize, height: usize) -> Self {
        assert!(
            x0 + width <= self.width && y0 + height <= self.height,
            "the crop lies inside the grid"
        );
        let mut data = Vec::with_capacity(width * height);
        for y in y0..y0 + height {
            data.extend_from_slice(&self.row(y)[x0..x0 + width]);
        }
        Self {
            width,
            height,
            data,
        }
    }
}

impl<T> std::ops::Index<(usize, usize)> for Grid<T> {
    type Output = T;

    /// Returns the value at `(column, row)`
    fn index(&self, (x, y): (usize, usize)) -> &T {
        debug_assert!(x < self.width);
        &self.data[y * self.width + x]
    }
}

impl<T> std::ops::IndexMut<(usize, usize)> for Grid<T> {
    fn index_mut(&mut self, (x, y): (usize, usize)) -> &mut T {
        debug_assert!(x < self.width);
        &mut self.data[y * self.width + x]
    }
}

impl Mask {
    /// Parses a drawing: rows separated by white space, `#` is inside, anything else outside
    ///
    /// ```
    /// use pirouette_geom::Mask;
    /// let mask = Mask::from_art("..# ###");
    /// assert_eq!((mask.width(), mask.height(), mask.area()), (3, 2, 4));
    /// ```
    ///
    /// # Panics
    /// When the rows differ in length.
    pub fn from_art(art: &str) -> Self {
        let rows: Vec<&str> = art.split_whitespace().collect();
        let width = rows.first().map_or(0, |row| row.len());
        let data = rows
            .iter()
            .flat_map(|row| row.bytes().map(|b| b == b'#'))
            .collect();
        Self::from_vec(width, rows.len(), data)
    }

    /// Draws the mask with `#` and `.`, one line per row
    pub fn to_art(&self) -> String {
        let mut art = String::with_capacity((self.width + 1) * self.height);
        for y in 0..self.height {
            art.extend(self.row(y).iter().map(|&v| if v { '#' } else { '.' }));
            art.push('\n');
        }
        art
    }

    /// Returns the number of pixels inside
    pub fn area(&self) -> usize {
        self.data.iter().filter(|&&v| v).count()
    }

    /// Returns the intersection over union with another mask of the same size; 1 for two empty masks
    ///
    /// # Panics
    /// When the sizes differ.
    pub fn iou(&self, other: &Mask) -> f64 {
        assert!(self.same_size(other), "the masks have the same size");
        let (mut both, mut either) = (0usize, 0usize);
        for (&a, &b) in self.data.iter().zip(&other.data) {
            both += usize::from(a && b);
            either += usize::from(a || b);
        }
        if either == 0 {
            1.0
        } else {
            both as f64 / either as f64
        }
    }

    /// Returns the bounding box of the inside, as `(x0, y0, x1, y1)` with exclusive ends
    pub fn bounding_box(&self) -> Option<(usize, usize, usize, usize)> {
        self.bounding_box_where(|&inside| inside)
    }
}

impl<T> Grid<T> {
    /// Returns the bounding box of the values for which `inside` is true, as `(x0, y0, x1, y1)` with exclusive ends
    pub fn bounding_box_where(
        &self,
        inside: impl Fn(&T) -> bool,
    ) -> Option<(usize, usize, usize, usize)> {
        let mut bounds: Option<(usize, usize, usize, usize)> = None;
        for y in 0..self.height {
            let row = self.row(y);
            // full rows and chunks at a time: most of them are empty
            let any = |pixels: &[T]| pixels.iter().fold(false, |any, v| any | inside(v));
            if !any(row) {
                continue;
            }
            let skipped = row.chunks_exact(64).take_while(|part| !any(part)).count();
            let Some(first) = row[64 * skipped..].iter().position(&inside) else {
                continue;
            };
            let first = 64 * skipped + first;
            let skipped = row.rchunks_exact(64).take_while(|part| !any(part)).count();
            let end = row.len() - 64 * skipped;
            let last = row[..end].iter().rposition(&inside).unwrap_or(first);
            bounds = Some(match bounds {
                None => (first, y, last + 1, y + 1),
                Some((x0, y0, x1, _)) => (x0.min(first), y0, x1.max(last + 1), y + 1),
            });
        }
        bounds
    }
}

impl Grid<f32> {
    /// Returns the mask of values of at least `level`
    pub fn threshold(&self, level: f32) -> Mask {
        self.map(|&v| v >= level)
    }
}

/// A raster that is zero outside of a window, of which only the window is stored
///
/// A silhouette takes a third of its photo.
#[derive(Debug, Clone, PartialEq)]
pub struct Windowed<T> {
    size: (usize, usize),
    corner: (usize, usize),
    window: Grid<T>,
}

impl<T: Clone + Default + PartialEq> Windowed<T> {
    /// Stores the nonzero values, with a ring of zeros around them within the raster
    pub fn new(whole: &Grid<T>) -> Self {
        let zero = T::default();
        let size = (whole.width, whole.height);
        let filled = whole.bounding_box_where(|value| *value != zero);
        let (x0, y0, x1, y1) = filled.unwrap_or_default();
        let (x0, y0) = (x0.saturating_sub(1), y0.saturating_sub(1));
        let (x1, y1) = ((x1 + 1).min(size.0), (y1 + 1).min(size.1));
        Self {
            size,
            corner: (x0, y0),
            window: whole.crop(x0, y0, x1 - x0, y1 - y0),
        }
    }

    /// Returns the number of columns of the full raster
    pub fn width(&self) -> usize {
        self.size.0
    }

    /// Returns the number of rows of the full raster
    pub fn height(&self) -> usize {
        self.size.1
    }

    /// Returns the column and row at which the window starts
    pub fn corner(&self) -> (usize, usize) {
        self.corner
    }

    /// Returns the stored window
    pub fn window(&self) -> &Grid<T> {
        &self.window
    }

    /// Returns the full raster
    pub fn to_grid(&self) -> Grid<T> {
        let mut whole = Grid::filled(self.size.0, self.size.1, T::default());
        let (x0, y0) = self.corner;
        for y in 0..self.window.height {
            let row = &mut whole.row_mut(y0 + y)[x0..x0 + self.window.width];
            row.clone_from_slice(self.window.row(y));
        }
        whole
    }
}

impl<T: fmt::Debug> fmt::Debug for Grid<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Grid({} x {})", self.width, self.height)
    }
}

/// Returns the number of pixels before the first with another value
pub(crate) fn run_length(pixels: &[bool], value: bool) -> usize {
    let same = |part: &[bool]| part.iter().fold(true, |same, &v| same & (v == value));
    let blocks = pixels.as_chunks::<16>().0;
    let block = blocks.iter().position(|block| !same(block));
    let from = 16 * block.unwrap_or(blocks.len());
    let rest = pixels[from..].iter().position(|&v| v != value);
    rest.map_or(pixels.len(), |rest| from + rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn art_survives_a_round_trip() {
        let mask = Mask::from_art(".#. ###");
        assert_eq!(mask.to_art(), ".#.\n###\n");
        assert_eq!(mask.bounding_box(), Some((0, 0, 3, 2)));
    }

    #[test]
    fn a_windowed_raster_survives_a_round_trip() {
        for art in ["..... ..#.. .##.. ..... .....", "#. ..", "... ...", ""] {
            let whole = Mask::from_art(art);
            let windowed = Windowed::new(&whole);
            assert_eq!(
                (windowed.width(), windowed.height()),
                (whole.width(), whole.height())
            );
            assert_eq!(windowed.to_grid(), whole);
        }
        let windowed = Windowed::new(&Mask::from_art("...... ...... ....#. ......"));
        assert_eq!(windowed.corner(), (3, 1));
        assert_eq!(windowed.window().to_art(), "...\n.#.\n...\n");
    }

    #[test]
    fn iou_counts_shared_pixels() {
        let a = Mask::from_art("##..");
        let b = Mask::from_art(".##.");
        assert!((a.iou(&b) - 1.0 / 3.0).abs() < 1e-12);
        let empty = Mask::filled(4, 1, false);
        assert!((empty.iou(&empty) - 1.0).abs() < 1e-12);
        assert_eq!(empty.bounding_box(), None);
    }

    #[test]
    fn get_is_none_outside() {
        let grid = Grid::from_fn(2, 2, |x, y| x + 2 * y);
        assert_eq!(grid.get(1, 1), Some(&3));
        assert_eq!(grid.get(-1, 0), None);
        assert_eq!(grid.get(0, 2), None);
        assert_eq!(grid.crop(1, 0, 1, 2).as_slice(), &[1, 3]);
    }
}
