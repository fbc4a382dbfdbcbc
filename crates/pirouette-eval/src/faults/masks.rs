//! Faults of given masks: the true silhouettes are given, and some of them changed.

use pirouette::scan::Scan;
use pirouette_geom::morphology::{dilate, erode};

use super::{Fault, Group, Setting, Strength, some_views};

pub(super) const FAULTS: [Fault; 4] = [
    Fault::new(Group::Masks, "too wide", ["1 px", "3 px", "6 px"], wide),
    Fault::new(Group::Masks, "too narrow", ["1 px", "3 px", "6 px"], narrow),
    Fault::new(
        Group::Masks,
        "of the next view",
        ["1 view", "half", "all"],
        of_next_view,
    ),
    Fault::new(
        Group::Masks,
        "inverted",
        ["1 view", "half", "all"],
        inverted,
    ),
];

/// Gives the true silhouettes as masks
pub(super) fn give_masks(scan: &mut Scan, setting: &Setting) {
    for (view, silhouette) in scan.views.iter_mut().zip(setting.silhouettes) {
        view.mask = Some(silhouette.clone());
    }
}

fn wide(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let radius = strength.pick([1.0, 3.0, 6.0]);
    for (view, silhouette) in scan.views.iter_mut().zip(setting.silhouettes) {
        view.mask = Some(dilate(silhouette, radius));
    }
}

fn narrow(scan: &mut Scan, setting: &Setting, strength: Strength) {
    let radius = strength.pick([1.0, 3.0, 6.0]);
    for (view, silhouette) in scan.views.iter_mut().zip(setting.silhouettes) {
        view.mask = Some(erode(silhouette, radius));
    }
}

fn of_next_view(scan: &mut Scan, setting: &Setting, strength: Strength) {
    give_masks(scan, setting);
    let count = scan.views.len();
    for index in some_views(count, strength) {
        let next = setting.silhouettes.get((index + 1) % count);
        scan.views[index].mask = next.cloned();
    }
}

fn inverted(scan: &mut Scan, setting: &Setting, strength: Strength) {
    give_masks(scan, setting);
    for index in some_views(scan.views.len(), strength) {
        let mask = &mut scan.views[index].mask;
        *mask = mask.as_ref().map(|mask| mask.map(|inside| !inside));
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::setting_of;
    use super::*;
    use pirouette_synthetic::people::turning_woman;

    #[test]
    fn masks_grow_and_shrink_and_photos_are_unchanged() {
        let woman = turning_woman(3);
        let area = |fault: fn(&mut Scan, &Setting, Strength)| {
            let mut scan = woman.scan.clone();
            fault(&mut scan, &setting_of(&woman), Strength::Weak);
            assert_eq!(scan.views[0].photo, woman.scan.views[0].photo);
            scan.views[0].mask.as_ref().unwrap().area()
        };
        let exact = woman.truth.silhouettes[0].area();
        assert!(area(narrow) < exact && exact < area(wide));
    }

    #[test]
    fn one_mask_is_inverted_and_the_others_are_exact() {
        let woman = turning_woman(4);
        let mut scan = woman.scan.clone();
        inverted(&mut scan, &setting_of(&woman), Strength::Weak);
        let exact =
            |index: usize| scan.views[index].mask.as_ref() == Some(&woman.truth.silhouettes[index]);
        assert_eq!([0, 1, 2, 3].map(exact), [true, false, true, true]);
    }
}
