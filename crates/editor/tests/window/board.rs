//! Where things stand on the board and in the table of lights, measured at every size of letters.

use clerestory::session::{BakeState, Source};
use clerestory_transport::bake::BakeConfig;
use eframe::egui::{Rangef, Rect, vec2};
use egui_kittest::kittest::Queryable;

use crate::desk::{Window, click, open_small, wait};

/// Sizes of letters, of the usual one.
const LETTERS: [f32; 4] = [1.0, 1.25, 1.5, 2.0];
/// The shortest fader that is set by hand, points.
const LEAST_FADER: f32 = 110.0;

/// The gallery with its seventeen lights, in three groups and alone.
fn gallery() -> Window {
    let config = BakeConfig { spp: 2, tolerance_db: 10.0, ..BakeConfig::default() };
    let mut window = open_small(Source::BuiltIn, config);
    wait(&mut window, |app| app.session().bake == BakeState::Done && app.n_pictures() > 0 && app.is_settled());
    window
}

/// What letters of a size leave of a window of 1440 × 900 points; answers the edge of the panel of lights.
fn with_letters(window: &mut Window, letters: f32) -> f32 {
    window.set_size(vec2(1440.0, 900.0) / letters);
    window.run_steps(8);
    window.get_by_label("Picture").rect().left()
}

fn place(window: &Window, label: &str) -> Rect {
    window.get_by_label(label).rect()
}

fn reach(window: &mut Window, label: &str) -> Rect {
    window.get_by_label(label).scroll_to_me();
    window.run_steps(10);
    place(window, label)
}

#[test]
fn faders_are_long_enough_and_those_of_groups_and_members_line_up() {
    let mut window = gallery();
    click(&mut window, "Board");
    for letters in LETTERS {
        let edge = with_letters(&mut window, letters);
        let rows = |window: &Window, labels: [&str; 2]| labels.map(|label| place(window, label).y_range());
        let [group, member] = rows(&window, ["Group clerestory intensity", "clerestory 1 intensity"]);
        assert!(group.span() >= LEAST_FADER, "{} points at {letters}", group.span());
        for [group, member] in [
            [group, member],
            rows(&window, ["Group clerestory factor", "clerestory 1 factor"]),
            rows(&window, ["Solo group clerestory", "Solo clerestory 1"]),
            rows(&window, ["Collapse clerestory", "clerestory 1 color"]),
        ] {
            let off = |a: f32, b: f32| (a - b).abs();
            assert!(off(group.min, member.min) < 1.0 && off(group.max, member.max) < 1.0, "{group:?} {member:?}");
        }
        // Nothing is cut off at the edge of the panel, and what lies below is scrolled to.
        for light in ["clerestory 3", "pendant 2", "spot 4", "cove", "ceiling panel"] {
            for what in ["intensity", "factor", "color"] {
                let columns = place(&window, &format!("{light} {what}")).x_range();
                assert!(
                    columns.min > 4.0 && columns.max < edge - 4.0,
                    "{light} {what}: {columns:?} of {edge}, {letters}"
                );
            }
        }
        let seen = Rangef::new(place(&window, "Group lights by").bottom(), place(&window, "Sky").top());
        let swatch = reach(&mut window, "ceiling panel color").y_range();
        assert!(seen.contains(swatch.min) && seen.contains(swatch.max), "{swatch:?} of {seen:?} at {letters}");
        reach(&mut window, "Group clerestory intensity");
    }
}

#[test]
fn a_wide_panel_has_fewer_rows_and_longer_faders() {
    let mut window = gallery();
    click(&mut window, "Board");
    let length = |window: &Window| place(window, "clerestory 1 intensity").height();
    with_letters(&mut window, 1.0);
    let all = length(&window);
    for group in ["clerestory", "pendant", "spot"] {
        click(&mut window, &format!("Collapse {group}"));
    }
    click(&mut window, "Expand clerestory");
    window.run_steps(3);
    assert!(length(&window) > 1.5 * all, "{} after {all}", length(&window));
    // Two rows of the ten and three strips that are left fill the panel, and no more.
    let last = place(&window, "ceiling panel color");
    assert!(last.bottom() < place(&window, "Sky").top(), "{last}");
}

#[test]
fn a_name_of_two_lines_can_be_read_on_the_board() {
    let mut window = gallery();
    let at = place(&window, "Mute pendant 1");
    let name = eframe::egui::pos2(at.right() + 20.0, at.center().y);
    window.hover_at(name);
    window.run_steps(2);
    window.drag_at(name);
    window.drop_at(name);
    window.run_steps(3);
    window.key_press(eframe::egui::Key::F2);
    window.run_steps(3);
    window.key_press_modifiers(eframe::egui::Modifiers::COMMAND, eframe::egui::Key::A);
    window.get_by_label("Name of pendant 1").type_text("Over the table");
    window.run_steps(2);
    window.key_press(eframe::egui::Key::Enter);
    window.run_steps(3);
    click(&mut window, "Select nothing");
    click(&mut window, "Board");
    for letters in LETTERS {
        with_letters(&mut window, letters);
        let (name, fader) = (place(&window, "Over the table"), place(&window, "Over the table intensity"));
        let number = place(&window, "Over the table factor");
        let is_wrapped = name.height() > 1.7 * place(&window, "pendant 2").height();
        assert!(is_wrapped || name.width() > 66.0, "{name} of {number} at {letters}");
        assert!(name.bottom() < fader.top() && number.x_range().expand(1.0).contains(name.left()), "{name} {fader}");
        assert!(number.x_range().expand(1.0).contains(name.right()), "{name} {number}");
    }
}

#[test]
fn names_stay_in_view_while_the_table_scrolls_and_all_of_it_fits_its_own_width() {
    let mut window = gallery();
    click(&mut window, "Table");
    // The position of the second window.
    const POSITION: &str = "-3.30, 3.06, -0.90";
    let edge = with_letters(&mut window, 1.0);
    assert!(place(&window, POSITION).right() < edge, "{} of {edge}", place(&window, POSITION));
    for letters in LETTERS {
        let edge = with_letters(&mut window, letters);
        let labels = ["Mute clerestory 2", "clerestory 2"];
        window.get_by_label("clerestory 2 factor").scroll_to_me();
        window.run_steps(10);
        let before = labels.map(|label| place(&window, label));
        assert!(before[1].left() >= before[0].right() && before[1].right() < edge, "{before:?} of {edge}");
        let position = reach(&mut window, POSITION);
        assert!(position.right() < edge, "{position} of {edge} at {letters}");
        let after = labels.map(|label| place(&window, label));
        assert_eq!(after, before, "the name stays where it is at {letters}");
        assert!(position.left() > after[1].right(), "beside the name: {position} {}", after[1]);
        let line = |rect: Rect| rect.center().y;
        assert!((line(position) - line(after[1])).abs() < 2.0, "in its line: {position} {}", after[1]);
    }
}

#[test]
fn a_small_window_has_its_buttons_in_a_line_and_the_settings_end_within_it() {
    let mut window = gallery();
    click(&mut window, "Movable lamps");
    window.set_size(vec2(1024.0, 700.0));
    for view in ["List", "Board", "Table"] {
        click(&mut window, view);
        window.run_steps(8);
        let [first, last] = ["Open…", "Shortcuts"].map(|label| place(&window, label));
        assert!((first.center().y - last.center().y).abs() < 1.0 && last.right() < 1020.0, "{first} {last}");
        // Where it is cut off, points: what is drawn ends before.
        for label in ["Number of patches", "Start bake", "Heat map"] {
            let right = reach(&mut window, label).right();
            assert!(right < 1019.5, "{label} ends at {right} beside the {view}");
        }
    }
}

#[test]
fn large_letters_cut_nothing_of_the_settings_and_leave_no_narrow_panel_behind() {
    let mut window = gallery();
    for section in ["Measure", "Numbers"] {
        reach(&mut window, section);
        click(&mut window, section);
    }
    let width = |window: &Window| place(window, "Start bake").width();
    let before = width(&window);
    assert!((place(&window, "View").left() - place(&window, "Move camera").left()).abs() < 1.0, "they line up");
    assert!(place(&window, "Add lamp").height() >= place(&window, "Board").height(), "it is as high as its neighbors");
    for letters in [1.5, 1.25, 1.0] {
        with_letters(&mut window, letters);
        let edge = 1440.0 / letters - 12.0;
        let all =
            ["Camera X", "Camera Z", "Copy as options", "Per lamp", "Per type", "Bookmark", "Share indirect light"];
        for label in all {
            let right = reach(&mut window, label).right();
            assert!(right < edge, "{label} ends at {right} of {edge} at {letters}");
        }
    }
    for view in ["Table", "List"] {
        click(&mut window, view);
        window.run_steps(4);
    }
    assert!((width(&window) - before).abs() < 1.0, "{} points after {before}", width(&window));
}
