//! A photo and what is known of it at half the size.

use pirouette_geom::Grid;

use crate::scene::SceneView;
use crate::seeds::{LogOdds, Seed};

/// A view at half its size, rounded up; each pixel stands for up to four
#[derive(Debug, Clone)]
pub(crate) struct HalfView {
    photo: Grid<[u8; 3]>,
    seeds: Grid<Seed>,
    prior: Option<Grid<LogOdds>>,
    scale: f64,
}

impl HalfView {
    /// Averages colors and odds; a seed is sure where all pixels agree
    pub(crate) fn new(view: &SceneView) -> Self {
        Self {
            photo: halved(view.photo, mean_color),
            seeds: halved(view.seeds, common_seed),
            prior: view.prior.map(|prior| halved(prior, mean_odds)),
            scale: view.scale / 2.0,
        }
    }

    pub(crate) fn view(&self) -> SceneView<'_> {
        SceneView {
            photo: &self.photo,
            seeds: &self.seeds,
            prior: self.prior.as_ref(),
            scale: self.scale,
        }
    }
}

/// One value for each two by two pixels; at an odd border the last ones count twice
fn halved<T: Copy>(grid: &Grid<T>, join: impl Fn([T; 4]) -> T) -> Grid<T> {
    let (width, height) = (grid.width().div_ceil(2), grid.height().div_ceil(2));
    let mut values = Vec::with_capacity(width * height);
    for y in 0..height {
        let upper = grid.row(2 * y);
        let lower = grid.row((2 * y + 1).min(grid.height() - 1));
        let (pairs, last) = upper.as_chunks::<2>();
        let (pairs_below, last_below) = lower.as_chunks::<2>();
        let joined = pairs.iter().zip(pairs_below);
        values.extend(joined.map(|(&[a, b], &[c, d])| join([a, b, c, d])));
        if let ([a], [c]) = (last, last_below) {
            values.push(join([*a, *a, *c, *c]));
        }
    }
    Grid::from_vec(width, height, values)
}

fn mean_color(colors: [[u8; 3]; 4]) -> [u8; 3] {
    [0, 1, 2].map(|channel| {
        let sum: u16 = colors.iter().map(|color| u16::from(color[channel])).sum();
        ((sum + 2) / 4) as u8
    })
}

fn common_seed(seeds: [Seed; 4]) -> Seed {
    if seeds.iter().all(|&seed| seed == seeds[0]) {
        return seeds[0];
    }
    if seeds.iter().filter(|seed| seed.person()).count() >= 2 {
        Seed::ProbablePerson
    } else {
        Seed::ProbableBackground
    }
}

fn mean_odds(odds: [LogOdds; 4]) -> LogOdds {
    LogOdds::new(odds.iter().map(|odds| odds.value()).sum::<f32>() / 4.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_are_averaged_and_odd_borders_count_twice() {
        let photo = Grid::from_vec(3, 1, vec![[0, 10, 255], [4, 11, 255], [9, 200, 7]]);
        let half = halved(&photo, mean_color);
        assert_eq!((half.width(), half.height()), (2, 1));
        assert_eq!(half.as_slice(), &[[2, 11, 255], [9, 200, 7]]);
    }

    #[test]
    fn seeds_are_sure_where_all_agree() {
        use Seed::*;
        assert_eq!(common_seed([Person; 4]), Person);
        assert_eq!(
            common_seed([Person, Person, Person, ProbablePerson]),
            ProbablePerson
        );
        assert_eq!(
            common_seed([Background, Background, Background, Person]),
            ProbableBackground
        );
        assert_eq!(common_seed([Background; 4]), Background);
    }

    #[test]
    fn odds_are_averaged() {
        let odds = [1.0, 2.0, -1.0, 0.0].map(LogOdds::new);
        assert_eq!(mean_odds(odds).value(), 0.5);
    }
}
