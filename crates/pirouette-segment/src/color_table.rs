//! Densities of two color models from a lookup table.

use pirouette_geom::Grid;
use pirouette_geom::parallel::prelude::*;

use crate::color_model::ColorModel;
use crate::seeds::Seed;

/// Leading bits of each level that select a cell
const BITS: usize = 7;

/// Cells per word of marks
const WORD: usize = u64::BITS as usize;

/// Color models of person and background
pub(crate) struct ModelPair {
    pub(crate) person: ColorModel,
    pub(crate) background: ColorModel,
}

/// Colors of the undecided pixels of a scene, quantized to cells of two levels per channel
///
/// A scene has far fewer cells than pixels.
pub(crate) struct ColorCells {
    /// One bit per cell
    marks: Vec<u64>,
    /// Number of marked cells before each word
    before: Vec<u32>,
    /// Centers of the marked cells
    colors: Vec<[f32; 3]>,
}

impl ColorCells {
    pub(crate) fn new<'a>(
        views: impl IntoParallelIterator<Item = (&'a Grid<[u8; 3]>, &'a Grid<Seed>)>,
    ) -> Self {
        let none = || vec![0_u64; (1 << (3 * BITS)) / WORD];
        let marks = views
            .into_par_iter()
            .fold(none, |mut marks, (photo, seeds)| {
                for (&color, seed) in photo.as_slice().iter().zip(seeds.as_slice()) {
                    if seed.undecided() {
                        let cell = cell(color);
                        marks[cell / WORD] |= 1 << (cell % WORD);
                    }
                }
                marks
            })
            .reduce(none, |mut a, b| {
                a.iter_mut().zip(&b).for_each(|(a, b)| *a |= b);
                a
            });
        let mut count = 0;
        let before = marks.iter().map(|word| {
            let before = count;
            count += word.count_ones();
            before
        });
        let before = before.collect();
        let mut colors = Vec::with_capacity(count as usize);
        for (index, &word) in marks.iter().enumerate() {
            let mut left = word;
            while left != 0 {
                colors.push(cell_center(index * WORD + left.trailing_zeros() as usize));
                left &= left - 1;
            }
        }
        Self {
            marks,
            before,
            colors,
        }
    }
}

/// Natural logarithms of the densities of both sides at the center of each cell
pub(crate) struct ColorTable<'a> {
    cells: &'a ColorCells,
    /// Person and background, per marked cell
    densities: Vec<[f32; 2]>,
}

impl<'a> ColorTable<'a> {
    /// Evaluates the models for all cells
    pub(crate) fn new(models: &ModelPair, cells: &'a ColorCells) -> Self {
        const PART: usize = 1024;
        let mut densities = vec![[0.0; 2]; cells.colors.len()];
        densities
            .par_chunks_mut(PART)
            .zip(cells.colors.par_chunks(PART))
            .for_each(|(densities, colors)| {
                let mut side = [0.0; PART];
                let side = &mut side[..colors.len()];
                for (place, model) in [&models.person, &models.background].into_iter().enumerate() {
                    model.log_densities(colors, side);
                    for (both, density) in densities.iter_mut().zip(&*side) {
                        both[place] = *density;
                    }
                }
            });
        Self { cells, densities }
    }

    /// Returns the log densities of a color as person and as background; unspecified if no undecided pixel has it
    pub(crate) fn log_densities(&self, color: [u8; 3]) -> [f32; 2] {
        let cell = cell(color);
        let below = self.cells.marks[cell / WORD] & ((1 << (cell % WORD)) - 1);
        let place = self.cells.before[cell / WORD] + below.count_ones();
        let found = self.densities.get(place as usize);
        found.copied().unwrap_or_default()
    }
}

fn cell(color: [u8; 3]) -> usize {
    let [r, g, b] = color.map(|level| usize::from(level) >> (8 - BITS));
    r << (2 * BITS) | g << BITS | b
}

/// Returns the color at the center of a cell
fn cell_center(cell: usize) -> [f32; 3] {
    const WIDTH: usize = 1 << (8 - BITS);
    let mask = (1 << BITS) - 1;
    [cell >> (2 * BITS), cell >> BITS & mask, cell & mask]
        .map(|level| (level * WIDTH) as f32 + (WIDTH - 1) as f32 / 2.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::color_model::ColorModelOptions;

    proptest! {
        #[test]
        fn table_densities_match_the_models(
            colors in prop::collection::vec(prop::array::uniform3(any::<u8>()), 40..300),
        ) {
            let fit = |samples: &[[u8; 3]]| {
                ColorModel::fit(samples, &ColorModelOptions::default()).unwrap()
            };
            let models = ModelPair { person: fit(&colors[..20]), background: fit(&colors[20..]) };
            let photo = Grid::from_vec(colors.len(), 1, colors.clone());
            let seeds = Grid::filled(colors.len(), 1, Seed::ProbablePerson);
            let cells = ColorCells::new(vec![(&photo, &seeds)]);
            let table = ColorTable::new(&models, &cells);
            for color in colors {
                let cell_center = color.map(|level| f32::from(level & !1) + 0.5);
                let mut expected = [0.0; 2];
                models.person.log_densities(&[cell_center], &mut expected[..1]);
                models.background.log_densities(&[cell_center], &mut expected[1..]);
                prop_assert_eq!(table.log_densities(color), expected);
            }
        }
    }

    #[test]
    fn unknown_colors_are_handled() {
        let model = ColorModel::fit(&[[9, 9, 9]; 9], &ColorModelOptions::default()).unwrap();
        let models = ModelPair {
            person: model.clone(),
            background: model,
        };
        let photo = Grid::filled(3, 1, [9, 9, 9]);
        let seeds = Grid::filled(3, 1, Seed::Person);
        let cells = ColorCells::new(vec![(&photo, &seeds)]);
        let table = ColorTable::new(&models, &cells);
        assert_eq!(table.log_densities([255; 3]), [0.0; 2]);
    }
}
