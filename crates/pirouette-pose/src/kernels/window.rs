//! Positions of a sliding window

use super::Shape;

/// Largest accepted height and width of a window
pub(crate) const MAX_KERNEL: usize = 8;

/// Rows or columns of a sliding window along one dimension of an image
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Span {
    /// Size of the window, 1 to [`MAX_KERNEL`]
    pub(crate) kernel: usize,
    /// Step between windows, at least 1
    pub(crate) stride: usize,
    /// Padding before the image
    pub(crate) before: usize,
    /// Number of windows, at least 1
    pub(crate) count: usize,
}

/// How a window is placed at the borders of the image
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Padding {
    /// As many windows as fit the image, rounded up; an odd pixel of padding is behind the image
    Same,
    /// Windows inside the image with these numbers of padding rows (or columns) before and behind
    Explicit(usize, usize),
}

impl Span {
    /// Places windows; `None` if none fits or a size is not supported.
    pub(crate) fn new(size: usize, kernel: usize, stride: usize, padding: Padding) -> Option<Self> {
        if size == 0 || !(1..=MAX_KERNEL).contains(&kernel) || !(1..=MAX_KERNEL).contains(&stride) {
            return None;
        }
        let (before, count) = match padding {
            Padding::Same => {
                let count = size.div_ceil(stride);
                (
                    ((count - 1) * stride + kernel).saturating_sub(size) / 2,
                    count,
                )
            }
            Padding::Explicit(before, behind) => (
                before,
                (size + before + behind).checked_sub(kernel)? / stride + 1,
            ),
        };
        Some(Self {
            kernel,
            stride,
            before,
            count,
        })
    }

    /// Index in the image of item `k` of window `i`, `None` if it is in the padding.
    #[inline(always)]
    pub(crate) fn index(&self, i: usize, k: usize, size: usize) -> Option<usize> {
        (i * self.stride + k)
            .checked_sub(self.before)
            .filter(|&index| index < size)
    }

    /// Items of window `i` that are inside the image; the range may be empty.
    pub(crate) fn inside(&self, i: usize, size: usize) -> std::ops::Range<usize> {
        let start = i * self.stride;
        let first = self.before.saturating_sub(start).min(self.kernel);
        let end = (self.before + size).saturating_sub(start).min(self.kernel);
        first..end.max(first)
    }

    /// Passes the rows of each window of an image with `height` rows to `compute`, with the number of the window and of its
    /// first padded row.
    ///
    /// Padded row `i` is slot `i % kernel` of `ring`; each is loaded once, by its number in the image. Slots of padding are
    /// zero.
    pub(crate) fn slide<T: Copy + Default>(
        &self,
        height: usize,
        ring: &mut [T],
        mut load: impl FnMut(usize, &mut [T]),
        mut compute: impl FnMut(usize, usize, &[T]),
    ) {
        ring.fill(T::default());
        let slot_len = ring.len() / self.kernel;
        let mut loaded = 0;
        for window in 0..self.count {
            let first = window * self.stride;
            for padded_row in loaded.max(first)..first + self.kernel {
                let slot = &mut ring[padded_row % self.kernel * slot_len..][..slot_len];
                match padded_row
                    .checked_sub(self.before)
                    .filter(|&row| row < height)
                {
                    Some(row) => load(row, slot),
                    None => slot.fill(T::default()),
                }
            }
            loaded = first + self.kernel;
            compute(window, first, ring);
        }
    }

    /// Number of padded rows (or columns) that the windows cover
    pub(crate) fn covered(&self) -> usize {
        (self.count - 1) * self.stride + self.kernel
    }
}

/// Sliding window over the rows and columns of an image
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) rows: Span,
    pub(crate) columns: Span,
}

impl Window {
    /// Number of positions in one window
    pub(crate) fn area(&self) -> usize {
        self.rows.kernel * self.columns.kernel
    }

    /// Size of the result with `channels` channels
    pub(crate) fn result(&self, channels: usize) -> Shape {
        Shape {
            height: self.rows.count,
            width: self.columns.count,
            channels,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Padding, Span};

    #[test]
    fn same_padding_puts_the_odd_pixel_behind() {
        let span = Span::new(8, 3, 2, Padding::Same).unwrap();
        assert_eq!((span.before, span.count, span.covered()), (0, 4, 9));
        let span = Span::new(8, 3, 1, Padding::Same).unwrap();
        assert_eq!((span.before, span.count), (1, 8));
        let span = Span::new(5, 1, 2, Padding::Same).unwrap();
        assert_eq!((span.before, span.count), (0, 3));
    }

    #[test]
    fn explicit_padding_rejects_windows_larger_than_the_image() {
        assert_eq!(Span::new(4, 5, 1, Padding::Explicit(0, 0)), None);
        assert_eq!(
            Span::new(4, 5, 2, Padding::Explicit(1, 1)).unwrap().count,
            1
        );
        assert_eq!(Span::new(4, 0, 1, Padding::Same), None);
        assert_eq!(Span::new(4, 1, 0, Padding::Same), None);
    }
}
