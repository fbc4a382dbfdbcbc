//! The part of rayon's interface that this workspace uses, on iterators of the standard library.

/// Runs one function, then the other; returns both results
pub fn join<A, B>(first: impl FnOnce() -> A, second: impl FnOnce() -> B) -> (A, B) {
    (first(), second())
}

/// All traits, for a single import
pub mod prelude {
    pub use super::{
        IndexedParallelIterator, IntoParallelIterator, IntoParallelRefIterator,
        IntoParallelRefMutIterator, ParallelIterator, ParallelSlice, ParallelSliceMut,
    };
}

/// An iterator of the standard library with the methods of rayon
///
/// It does not implement `Iterator` itself: `fold` and `reduce` have other parameters there.
#[derive(Debug, Clone)]
pub struct Serial<I>(I);

/// Conversion of a collection or range
pub trait IntoParallelIterator {
    /// The iterator
    type Iter: ParallelIterator<Item = Self::Item>;
    /// The type of its items
    type Item;

    /// Returns the iterator over the items
    fn into_par_iter(self) -> Self::Iter;
}

impl<C: IntoIterator> IntoParallelIterator for C {
    type Iter = Serial<C::IntoIter>;
    type Item = C::Item;

    fn into_par_iter(self) -> Self::Iter {
        Serial(self.into_iter())
    }
}

impl<I: Iterator> IntoParallelIterator for Serial<I> {
    type Iter = Self;
    type Item = I::Item;

    fn into_par_iter(self) -> Self {
        self
    }
}

/// Iteration by reference
pub trait IntoParallelRefIterator<'a> {
    /// The iterator
    type Iter: ParallelIterator<Item = Self::Item>;
    /// A shared reference
    type Item;

    /// Returns the iterator over references to the items
    fn par_iter(&'a self) -> Self::Iter;
}

impl<'a, C: ?Sized + 'a> IntoParallelRefIterator<'a> for C
where
    &'a C: IntoIterator,
{
    type Iter = Serial<<&'a C as IntoIterator>::IntoIter>;
    type Item = <&'a C as IntoIterator>::Item;

    fn par_iter(&'a self) -> Self::Iter {
        Serial(self.into_iter())
    }
}

/// Iteration by mutable reference
pub trait IntoParallelRefMutIterator<'a> {
    /// The iterator
    type Iter: ParallelIterator<Item = Self::Item>;
    /// A mutable reference
    type Item;

    /// Returns the iterator over mutable references to the items
    fn par_iter_mut(&'a mut self) -> Self::Iter;
}

impl<'a, C: ?Sized + 'a> IntoParallelRefMutIterator<'a> for C
where
    &'a mut C: IntoIterator,
{
    type Iter = Serial<<&'a mut C as IntoIterator>::IntoIter>;
    type Item = <&'a mut C as IntoIterator>::Item;

    fn par_iter_mut(&'a mut self) -> Self::Iter {
        Serial(self.into_iter())
    }
}

/// Iteration over parts of a slice
pub trait ParallelSlice<T> {
    /// Returns the parts of `size` items; the last one may be shorter
    fn par_chunks(&self, size: usize) -> Serial<std::slice::Chunks<'_, T>>;
}

impl<T> ParallelSlice<T> for [T] {
    fn par_chunks(&self, size: usize) -> Serial<std::slice::Chunks<'_, T>> {
        Serial(self.chunks(size))
    }
}

/// Iteration over parts of a mutable slice, and sorting
pub trait ParallelSliceMut<T> {
    /// Returns the parts of `size` items; the last one may be shorter
    fn par_chunks_mut(&mut self, size: usize) -> Serial<std::slice::ChunksMut<'_, T>>;

    /// Sorts without keeping the order of equal items
    fn par_sort_unstable(&mut self)
    where
        T: Ord;
}

impl<T> ParallelSliceMut<T> for [T] {
    fn par_chunks_mut(&mut self, size: usize) -> Serial<std::slice::ChunksMut<'_, T>> {
        Serial(self.chunks_mut(size))
    }

    fn par_sort_unstable(&mut self)
    where
        T: Ord,
    {
        self.sort_unstable();
    }
}

/// Adapters and consumers of any iterator
pub trait ParallelIterator: Sized {
    /// The type of the items
    type Item;

    /// Returns the same items as an iterator of the standard library
    fn into_serial(self) -> impl Iterator<Item = Self::Item>;

    /// Applies a function to each item
    fn map<R>(self, f: impl Fn(Self::Item) -> R) -> Serial<impl Iterator<Item = R>> {
        Serial(self.into_serial().map(f))
    }

    /// Applies a function to each item, with a value created by `init`
    fn map_init<S, R>(
        self,
        init: impl Fn() -> S,
        f: impl Fn(&mut S, Self::Item) -> R,
    ) -> Serial<impl Iterator<Item = R>> {
        let mut state = init();
        Serial(self.into_serial().map(move |item| f(&mut state, item)))
    }

    /// Keeps the items for which a condition holds
    fn filter(
        self,
        keep: impl Fn(&Self::Item) -> bool,
    ) -> Serial<impl Iterator<Item = Self::Item>> {
        Serial(self.into_serial().filter(move |item| keep(item)))
    }

    /// Applies a function to each item and keeps the `Some` values
    fn filter_map<R>(self, f: impl Fn(Self::Item) -> Option<R>) -> Serial<impl Iterator<Item = R>> {
        Serial(self.into_serial().filter_map(f))
    }

    /// Applies a function to each item and iterates over the items of all results
    fn flat_map_iter<C: IntoIterator>(
        self,
        f: impl Fn(Self::Item) -> C,
    ) -> Serial<impl Iterator<Item = C::Item>> {
        Serial(self.into_serial().flat_map(f))
    }

    /// Folds the items, starting from an identity, into one accumulator for `reduce` or `collect`
    fn fold<A>(
        self,
        identity: impl Fn() -> A,
        f: impl Fn(A, Self::Item) -> A,
    ) -> Serial<impl Iterator<Item = A>> {
        Serial(std::iter::once(self.into_serial().fold(identity(), f)))
    }

    /// Combines all items, starting from an identity
    fn reduce(
        self,
        identity: impl Fn() -> Self::Item,
        f: impl Fn(Self::Item, Self::Item) -> Self::Item,
    ) -> Self::Item {
        self.into_serial().fold(identity(), f)
    }

    /// Calls a function with each item
    fn for_each(self, f: impl Fn(Self::Item)) {
        self.into_serial().for_each(f);
    }

    /// Returns the sum of all items
    fn sum<S: std::iter::Sum<Self::Item>>(self) -> S {
        self.into_serial().sum()
    }

    /// Returns the largest item, `None` without items
    fn max(self) -> Option<Self::Item>
    where
        Self::Item: Ord,
    {
        self.into_serial().max()
    }

    /// Collects all items, in order
    fn collect<C: FromIterator<Self::Item>>(self) -> C {
        self.into_serial().collect()
    }

    /// Splits the items of all pairs into two collections, in order
    fn unzip<A, B, C, D>(self) -> (C, D)
    where
        Self: ParallelIterator<Item = (A, B)>,
        C: Default + Extend<A>,
        D: Default + Extend<B>,
    {
        self.into_serial().unzip()
    }
}

impl<I: Iterator> ParallelIterator for Serial<I> {
    type Item = I::Item;

    fn into_serial(self) -> impl Iterator<Item = I::Item> {
        self.0
    }
}

/// Adapters of iterators with indexed items
pub trait IndexedParallelIterator: ParallelIterator {
    /// Pairs the items with those of another iterator, up to the shorter one
    fn zip<C: IntoParallelIterator>(
        self,
        other: C,
    ) -> Serial<impl Iterator<Item = (Self::Item, C::Item)>> {
        let other = other.into_par_iter().into_serial();
        Serial(self.into_serial().zip(other))
    }

    /// Pairs each item with its index, from 0 on
    fn enumerate(self) -> Serial<impl Iterator<Item = (usize, Self::Item)>> {
        Serial(self.into_serial().enumerate())
    }

    /// Has no effect: there is one thread
    fn with_min_len(self, _count: usize) -> Self {
        self
    }
}

impl<I: Iterator> IndexedParallelIterator for Serial<I> {}
