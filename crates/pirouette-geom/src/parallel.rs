//! Parallel iterators: those of rayon, or serial ones of the same names without the feature `parallel`.
//!
//! Call sites import [`prelude`] and serve both builds. Both give equal results: these crates avoid parallel sums of
//! floats, whose order of additions is not fixed.
//!
//! Not part of the stable interface: only for the crates of this workspace.
//!
//! # Examples
//! ```
//! use pirouette_geom::parallel::{join, prelude::*};
//! let squares: Vec<u32> = (0..4_u32).into_par_iter().map(|x| x * x).collect();
//! assert_eq!(squares, [0, 1, 4, 9]);
//! assert_eq!(join(|| 1, || "two"), (1, "two"));
//! ```

#[cfg(feature = "parallel")]
pub use rayon::{join, prelude};

#[cfg(not(feature = "parallel"))]
mod serial;

#[cfg(not(feature = "parallel"))]
pub use serial::{join, prelude};

#[cfg(test)]
mod tests {
    use super::join;
    use super::prelude::*;

    #[test]
    fn slices_vectors_ranges_and_arrays_are_visited_in_order() {
        let values = vec![3, 1, 2];
        let doubled: Vec<i32> = values.par_iter().map(|v| 2 * v).collect();
        assert_eq!(doubled, [6, 2, 4]);
        let odd: Vec<i32> = values.into_par_iter().filter(|v| v % 2 == 1).collect();
        assert_eq!(odd, [3, 1]);
        let halves: Vec<usize> = (0..5).into_par_iter().filter_map(half).collect();
        assert_eq!(halves, [0, 1, 2]);
        let repeated: Vec<usize> = [1, 2]
            .into_par_iter()
            .flat_map_iter(|count| std::iter::repeat_n(count, count))
            .collect();
        assert_eq!(repeated, [1, 2, 2]);
    }

    fn half(value: usize) -> Option<usize> {
        value.is_multiple_of(2).then_some(value / 2)
    }

    #[test]
    fn chunks_are_zipped_with_chunks_and_enumerated() {
        let mut sums = [0; 5];
        let terms = [1, 2, 3, 4, 5];
        sums.par_chunks_mut(2)
            .zip(terms.par_chunks(2))
            .enumerate()
            .for_each(|(chunk, (sums, terms))| {
                for (sum, term) in sums.iter_mut().zip(terms) {
                    *sum = 10 * chunk + term;
                }
            });
        assert_eq!(sums, [1, 2, 13, 14, 25]);
        sums.par_iter_mut().for_each(|sum| *sum += 1);
        assert_eq!(sums, [2, 3, 14, 15, 26]);
    }

    #[test]
    fn folds_are_reduced_from_their_identities() {
        let word = |letters: &[char]| {
            letters
                .par_iter()
                .fold(String::new, |word, &letter| {
                    word + letter.to_string().as_str()
                })
                .reduce(String::new, |head, tail| head + &tail)
        };
        assert_eq!(word(&['w', 'o', 'r', 'd']), "word");
        assert_eq!(word(&[]), "");
        let sum: u32 = [1_u32, 2, 3].par_iter().sum();
        assert_eq!(sum, 6);
        assert_eq!([2, 7, 5].par_iter().max(), Some(&7));
    }

    #[test]
    fn results_are_collected_unzipped_sorted_and_joined() {
        let checked = |limit: i32| -> Result<Vec<i32>, i32> {
            let values = [1, 2, 3].into_par_iter();
            values
                .map(|v| if v < limit { Ok(v) } else { Err(v) })
                .collect()
        };
        assert_eq!(checked(9), Ok(vec![1, 2, 3]));
        assert_eq!(checked(3), Err(3));
        let (low, high): (Vec<i32>, Vec<i32>) = [1, 2].into_par_iter().map(|v| (v, 10 * v)).unzip();
        assert_eq!((low, high), (vec![1, 2], vec![10, 20]));
        let mut letters = ['c', 'a', 'b'];
        letters.par_sort_unstable();
        assert_eq!(join(|| letters, || letters.len()), (['a', 'b', 'c'], 3));
    }

    #[test]
    fn scratch_memory_is_made_by_the_iterator() {
        let lengths: Vec<usize> = [3, 1]
            .par_iter()
            .map_init(Vec::new, |scratch, &count| {
                scratch.clear();
                scratch.resize(count, 0_u8);
                scratch.len()
            })
            .collect();
        assert_eq!(lengths, [3, 1]);
    }
}
