use proptest::prelude::*;

use super::figure::overlap;
use super::rough::{
    Background, Blocks, Estimate, Votes, as_exposed, blocks, common_background, rough_silhouette,
};
use super::shrunk;
use crate::scan::Photo;
use pirouette_geom::{Grid, Mask};

const GRAY: [f32; 3] = [60.0, 0.0, 0.0];
const BLUE: [f32; 3] = [40.0, 50.0, -20.0];

/// A gray view with a blue box
fn view_with_box(columns: std::ops::Range<usize>) -> Blocks {
    Grid::from_fn(40, 30, |x, y| {
        let inside = columns.contains(&x) && (5..25).contains(&y);
        if inside { BLUE } else { GRAY }
    })
}

fn estimate(inside: Mask, width: usize, height: usize) -> Estimate {
    Estimate {
        hidden: inside.clone(),
        near: Mask::filled(width, height, true),
        inside,
    }
}

#[test]
fn blocks_average_colors_and_leave_out_incomplete_ones() {
    let photo = Photo::from_fn(5, 4, |x, _| if x % 2 == 0 { [0; 3] } else { [100; 3] });
    let found = blocks(&photo, 2);
    assert_eq!((found.width(), found.height()), (2, 2));
    // Half of 100 levels, times the weight of brightness
    assert!((found[(1, 1)][0] - 30.0).abs() < 1e-3);
    assert!(found[(1, 1)][1].abs() < 1e-3 && found[(1, 1)][2].abs() < 1e-3);
}

#[test]
fn the_background_is_what_most_views_show() {
    let views = [
        view_with_box(5..12),
        view_with_box(12..20),
        view_with_box(20..30),
    ];
    let background = common_background(&views, None, Votes::Plain).expect("three views");
    assert!(
        background
            .as_slice()
            .iter()
            .all(|&color| color == Some(GRAY))
    );
}

#[test]
fn a_figure_hides_the_background_behind_it() {
    // Most views agree on the box where they overlap.
    let views = [
        view_with_box(5..20),
        view_with_box(10..25),
        view_with_box(10..25),
        view_with_box(30..40),
    ];
    let found = common_background(&views, None, Votes::Plain).expect("four views");
    assert_eq!(found[(15, 15)], Some(BLUE));
    let figures = views
        .each_ref()
        .map(|view| estimate(view.map(|color| color[0] < 50.0), 40, 30));
    let found = common_background(&views, Some(&figures), Votes::Plain).expect("four views");
    assert_eq!(found[(15, 15)], Some(GRAY));
    let all = views
        .each_ref()
        .map(|_| estimate(Mask::filled(40, 30, true), 40, 30));
    let found = common_background(&views, Some(&all), Votes::Plain).expect("four views");
    assert!(found.as_slice().iter().all(Option::is_none));
}

#[test]
fn clothes_that_most_views_show_are_not_the_background() {
    // Three of five views show the box at column 15; where four of five agree, gray is background and blue is not.
    let views = [
        view_with_box(5..16),
        view_with_box(14..17),
        view_with_box(15..26),
        view_with_box(20..22),
        view_with_box(30..40),
    ];
    let at = |votes: Votes| {
        let found = common_background(&views, None, votes).expect("five views");
        found[(15, 15)]
    };
    assert_eq!(at(Votes::Plain), Some(BLUE));
    assert_eq!(at(Votes::ByPalette), Some(GRAY));
}

#[test]
fn what_differs_from_the_background_is_the_silhouette() {
    let background: Background = Grid::filled(40, 30, Some(GRAY));
    let found = rough_silhouette(&view_with_box(10..20), &background, None);
    let expected = Mask::from_fn(40, 30, |x, y| (10..20).contains(&x) && (5..25).contains(&y));
    assert!(found.iou(&expected) > 0.95, "{}", found.to_art());
    assert_eq!(
        rough_silhouette(&view_with_box(0..0), &background, None).area(),
        0
    );
}

#[test]
fn the_figure_decides_where_the_background_is_unknown() {
    let unknown: Background = Grid::filled(40, 30, None);
    let inside = Mask::from_fn(40, 30, |x, y| (10..20).contains(&x) && (5..25).contains(&y));
    let figure = estimate(inside.clone(), 40, 30);
    let found = rough_silhouette(&view_with_box(0..0), &unknown, Some(&figure));
    assert!(found.iou(&inside) > 0.95, "{}", found.to_art());
}

#[test]
fn another_exposure_of_the_background_is_equalized() {
    let darker: Background = Grid::filled(40, 30, Some([GRAY[0] - 20.0, 0.0, 3.0]));
    let equal = as_exposed(&darker, &view_with_box(10..20));
    assert_eq!(equal[(0, 0)], Some(GRAY));
    assert_eq!(equal[(15, 15)], Some(GRAY));
}

#[test]
fn masks_shrink_to_the_middle_of_each_block() {
    let mask = Mask::from_art("###### ###### ###... ###... ###...");
    assert_eq!(shrunk(&mask, 3).to_art(), "##\n");
}

proptest! {
    #[test]
    fn overlaps_are_those_of_all_pixels(
        seed in prop::collection::vec(any::<bool>(), 2 * 9 * 7),
        right in -12_isize..12,
        down in -12_isize..12,
    ) {
        let mask = |start: usize| Mask::from_vec(9, 7, seed[start..start + 63].to_vec());
        let (shifted, fixed) = (mask(0), mask(63));
        let expected = (0..63).filter(|i| {
            let (x, y) = ((i % 9) as isize, (i / 9) as isize);
            fixed[(i % 9, i / 9)] && shifted.get(x - right, y - down).is_some_and(|&inside| inside)
        });
        if let Some(bounds) = shifted.bounding_box() {
            prop_assert_eq!(overlap(&shifted, bounds, &fixed, (right, down)), expected.count());
        }
    }
}
