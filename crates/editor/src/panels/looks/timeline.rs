//! The timeline: keys on a ruler, a playhead that is dragged or runs, and frames for files.

use eframe::egui::{
    self, Align2, Button, Color32, ComboBox, FontId, PointerButton, Pos2, ProgressBar, Rect, Response, RichText, Sense,
    Shape, Stroke, StrokeKind, Ui, pos2, vec2,
};

use super::{LooksView, NO_PICTURE, in_row};
use crate::action::{Action, FileTask};
use crate::look::Look;
use crate::look::timeline::{Ease, FPS, Key, SECS, Timeline};
use crate::panels::arrows::arrows;
use crate::panels::number::Number;
use crate::panels::sight::keep_in_sight;
use crate::theme;

/// Height of ruler and keys, points.
const HEIGHT: f32 = 46.0;
/// Where the line of the keys is, from the top.
const LINE: f32 = 30.0;
/// Distance in points in which a key is touched.
const REACH: f32 = 9.0;
/// Least time that the ruler shows, seconds.
const LEAST_SECS: f32 = 5.0;
/// Frames that an arrow key goes on with Shift; one without.
const FRAMES_WITH_SHIFT: f32 = 10.0;
/// Height of a list of looks, points; more of them are scrolled.
const MENU_HEIGHT: f32 = 320.0;
/// Said where a timeline is to be played or written that is empty.
const NO_KEYS: &str = "Add a key first";
/// Time between the last key and one that is added behind it.
const NEXT_SECS: f32 = 2.0;

/// What the timeline remembers and no look holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Player {
    /// The moment that is shown instead of the present look, seconds; none shows the present look.
    pub playhead: Option<f32>,
    /// Whether it runs.
    pub playing: bool,
    /// Whether it begins again at its end.
    pub loops: bool,
    /// Key that was touched last.
    chosen: Option<usize>,
    /// Key that is being dragged.
    dragged: Option<HeldKey>,
}

/// A key that is dragged.
#[derive(Clone, Debug, PartialEq)]
struct HeldKey {
    /// Where it stands now.
    idx: usize,
    /// How far to the right of the pointer it was taken, points.
    off: f32,
    /// Where it stood, among which keys.
    before: (usize, Vec<Key>),
}

impl Player {
    /// Back to the present look.
    pub fn stop(&mut self) {
        (self.playhead, self.playing) = (None, false);
    }

    /// Lets time pass; it stays at the end, or begins again.
    pub fn advance(&mut self, timeline: &Timeline, secs: f32) {
        let Some(playhead) = &mut self.playhead else { return };
        if timeline.keys.is_empty() {
            self.stop();
        } else if self.playing {
            let end = timeline.end_secs();
            let (now, begins_again) = (*playhead + secs, self.loops && end > 0.0);
            *playhead = if begins_again { now % end } else { now.min(end) };
            self.playing = begins_again || now < end;
        }
    }

    /// Goes so many frames on and stays there.
    fn step(&mut self, timeline: &Timeline, n_frames: f32) {
        if n_frames == 0.0 || timeline.keys.is_empty() {
            return;
        }
        let frame = (self.playhead.unwrap_or(0.0) * timeline.fps).round() + n_frames;
        (self.playhead, self.playing) = (Some((frame / timeline.fps).clamp(0.0, timeline.end_secs())), false);
    }

    /// The key that was touched last.
    pub fn chosen(&self) -> Option<usize> {
        self.chosen
    }

    /// Chooses no key.
    pub fn let_go(&mut self) {
        (self.chosen, self.dragged) = (None, None);
    }

    /// Takes the chosen key away, where one is chosen.
    pub fn delete_key(&mut self, timeline: &mut Timeline) {
        if let Some(idx) = self.chosen.take().filter(|idx| *idx < timeline.keys.len()) {
            timeline.keys.remove(idx);
        }
        self.dragged = None;
    }

    fn play(&mut self, timeline: &Timeline) {
        let is_at_end = self.playhead.is_none_or(|secs| secs >= timeline.end_secs());
        if is_at_end {
            self.playhead = Some(0.0);
        }
        self.playing = true;
    }
}

/// Draws it.
pub(super) fn timeline_ui(
    ui: &mut Ui,
    look: &mut Look,
    player: &mut Player,
    view: &LooksView,
    actions: &mut Vec<Action>,
) {
    player.chosen = player.chosen.filter(|idx| *idx < look.timeline.keys.len());
    // A line for what is always there and one for the key: nothing moves away under the pointer.
    ui.horizontal_wrapped(|ui| {
        play_ui(ui, look, player);
        frames_ui(ui, look, view, actions);
        moment_ui(ui, look, player, view);
    });
    ui.horizontal_wrapped(|ui| {
        add_ui(ui, look, player);
        key_ui(ui, look, player);
    });
    track_ui(ui, look, player);
}

fn play_ui(ui: &mut Ui, look: &Look, player: &mut Player) {
    let has_keys = !look.timeline.keys.is_empty();
    let words = if player.playing { "Pause" } else { "Play" };
    let play = ui.add_enabled(has_keys, Button::new(words)).accessible_name("Play the timeline");
    if play.on_hover_text("Play at real time, L").on_disabled_hover_text(NO_KEYS).clicked() {
        toggle(player, &look.timeline);
    }
    let back = ui.add_enabled(player.playhead.is_some(), Button::new("Stop")).accessible_name("Back to the lights");
    let back = back.on_hover_text("Stop, and show the lights as they are now");
    if back.on_disabled_hover_text("The lights are shown as they are now").clicked() {
        player.stop();
    }
    ui.checkbox(&mut player.loops, "Loop").on_hover_text("Begin again at the end");
}

/// The moment that is shown, where one is.
fn moment_ui(ui: &mut Ui, look: &mut Look, player: &mut Player, view: &LooksView) {
    let Some(secs) = player.playhead else { return };
    let frame = (secs * look.timeline.fps).round();
    ui.label(RichText::new(format!("{secs:.2} s, frame {frame}")).color(theme::accent_text(ui)));
    let hint = "Light the scene as the timeline does at this moment";
    if ui.add(Button::new("Take over").small()).on_hover_text(hint).clicked() {
        let moment = look.at(secs, view.basis);
        (look.lights, look.display, look.on) = (moment.lights, moment.display, None);
        player.stop();
    }
}

/// Plays, or stays where it is.
pub fn toggle(player: &mut Player, timeline: &Timeline) {
    if player.playing {
        player.playing = false;
    } else if !timeline.keys.is_empty() {
        player.play(timeline);
    }
}

fn add_ui(ui: &mut Ui, look: &mut Look, player: &mut Player) {
    let hint = "Add a key with one of the looks: at the playhead, else behind the last key";
    ui.menu_button("Add key", |ui| {
        let names: Vec<String> = look.snapshots.iter().map(|snapshot| snapshot.name.clone()).collect();
        egui::ScrollArea::vertical().max_height(MENU_HEIGHT).show(ui, |ui| {
            for name in names {
                if ui.button(in_row(&name)).clicked() {
                    let behind = look.timeline.keys.last().map_or(0.0, |key| key.secs + NEXT_SECS);
                    let secs = player.playhead.unwrap_or(behind);
                    player.chosen = Some(look.timeline.add(Key { secs, look: name, ease: Ease::default() }));
                    ui.close();
                }
            }
            keep_in_sight(ui, "looks for a key");
        });
    })
    .response
    .on_hover_text(hint);
}

/// The key that is chosen.
fn key_ui(ui: &mut Ui, look: &mut Look, player: &mut Player) {
    let Some(idx) = player.chosen else {
        let words = if look.timeline.keys.is_empty() { "" } else { "Click a key to change it" };
        _ = ui.label(RichText::new(words).weak());
        return;
    };
    ui.separator();
    let Key { mut secs, look: name, ease } = look.timeline.keys[idx].clone();
    let number = Number::new(&mut secs).range(0.0..=*SECS.end() as f32).speed(0.02).suffix(" s").max_decimals(3);
    let time = ui.add(number).accessible_name("Time of the key").on_hover_text("When it is reached, seconds");
    let key = &mut look.timeline.keys[idx];
    let shown = ComboBox::from_id_salt("look of the key").selected_text(in_row(&name)).show_ui(ui, |ui| {
        for snapshot in &look.snapshots {
            ui.selectable_value(&mut key.look, snapshot.name.clone(), in_row(&snapshot.name));
        }
    });
    shown.response.accessible_name("Look of the key");
    let eases = ComboBox::from_id_salt("ease").width(70.0).selected_text(ease.words()).show_ui(ui, |ui| {
        Ease::ALL.iter().for_each(|(ease, _, words)| drop(ui.selectable_value(&mut key.ease, *ease, *words)));
    });
    eases.response.accessible_name("Way to the next key").on_hover_text("How it becomes the next look");
    if time.changed() {
        player.chosen = Some(look.timeline.move_to(idx, secs));
    }
    if ui.button("Delete key").clicked() {
        player.delete_key(&mut look.timeline);
    }
}

/// Export, frames of a second, or how far the frames are.
fn frames_ui(ui: &mut Ui, look: &mut Look, view: &LooksView, actions: &mut Vec<Action>) {
    if let Some((done, of)) = view.frames {
        if ui.button("Cancel").accessible_name("Cancel the frames").clicked() {
            actions.push(Action::CancelFrames);
        }
        let bar = ProgressBar::new(done as f32 / of.max(1) as f32).desired_width(120.0);
        ui.add(bar.text(format!("{done} of {of}"))).accessible_name("Frames that are written");
        return;
    }
    let can_export = view.can_export && !look.timeline.keys.is_empty();
    let hint = "Write every frame as PNG or linear EXR; # stands for the digits of its number";
    let why = if view.can_export { NO_KEYS } else { NO_PICTURE };
    let export = ui.add_enabled(can_export, Button::new("Export frames…")).on_hover_text(hint);
    if export.on_disabled_hover_text(why).clicked() {
        actions.push(Action::Ask(FileTask::ExportFrames));
    }
    let fps = Number::new(&mut look.timeline.fps).range(*FPS.start() as f32..=*FPS.end() as f32).suffix(" fps");
    ui.add(fps.speed(0.1).max_decimals(3)).accessible_name("Frames per second").on_hover_text("Frames of a second");
}

/// Seconds along the ruler.
struct Ruler {
    rect: Rect,
    secs: f32,
}

impl Ruler {
    /// Points along which time runs; some in any window.
    fn length(&self) -> f32 {
        (self.rect.width() - 24.0).max(1.0)
    }

    fn x(&self, secs: f32) -> f32 {
        self.rect.left() + 12.0 + secs / self.secs * self.length()
    }

    fn secs_at(&self, x: f32) -> f32 {
        ((x - self.rect.left() - 12.0) / self.length() * self.secs).clamp(0.0, *SECS.end() as f32)
    }

    /// Seconds between two marks with a number: at least 56 points apart.
    fn step(&self) -> f32 {
        let least = 56.0 / self.length() * self.secs;
        let steps = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0];
        steps.into_iter().find(|step| *step >= least).unwrap_or(7200.0)
    }
}

fn track_ui(ui: &mut Ui, look: &mut Look, player: &mut Player) {
    let size = vec2(ui.available_width(), HEIGHT);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    let at = f64::from(player.playhead.unwrap_or(0.0));
    response.widget_info(|| egui::WidgetInfo::slider(true, at, "Timeline ruler"));
    // While something is dragged the ruler stays as it is.
    let secs = ui.data_mut(|data| {
        let kept = data.get_temp_mut_or::<f32>(response.id, LEAST_SECS);
        if !response.dragged() {
            *kept = (1.15 * look.timeline.end_secs()).max(LEAST_SECS);
        }
        *kept
    });
    let ruler = Ruler { rect, secs };
    drag_ui(ui, &response, &ruler, look, player);
    player.step(&look.timeline, arrows(ui, &response, FRAMES_WITH_SHIFT).x);
    let mut focused = None;
    for (idx, key) in look.timeline.keys.iter().enumerate() {
        let center = pos2(ruler.x(key.secs), rect.top() + LINE);
        let place = Rect::from_center_size(center, egui::Vec2::splat(2.0 * REACH));
        let key_response = ui.interact(place, response.id.with(idx), Sense::click());
        let label = format!("Key {}: {} at {:.2} s", idx + 1, key.look, key.secs);
        key_response
            .widget_info(|| egui::WidgetInfo::selected(egui::Role::Button, true, player.chosen == Some(idx), &label));
        focused = focused.or(key_response.has_focus().then_some(place));
        if key_response.on_hover_text(format!("{label}\nDrag to move it")).clicked() {
            player.chosen = Some(idx);
        }
    }
    paint(ui, (&ruler, &response), &look.timeline, player);
    if let Some(place) = focused {
        ui.painter_at(rect).rect_stroke(place, 3.0, ui.visuals().selection.stroke, StrokeKind::Inside);
    }
}

/// The key that a drag from `press` to the pointer takes: the nearest one. Of several at one time it is the first where the way leads back,
/// else the last, so that each end of a cut can be had.
fn taken(keys: &[Key], ruler: &Ruler, press: Pos2, pointer: Pos2) -> Option<usize> {
    let distance = |key: &Key| (pos2(ruler.x(key.secs), ruler.rect.top() + LINE) - press).length();
    let near = keys.iter().enumerate().filter(|(_, key)| distance(key) < 1.5 * REACH);
    let (first, nearest) = near.min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)))?;
    let last = keys.iter().rposition(|key| key.secs == nearest.secs);
    if pointer.x < press.x { Some(first) } else { last }
}

/// A press on a key drags it, Esc puts it back; elsewhere the playhead comes to the pointer.
fn drag_ui(ui: &Ui, response: &Response, ruler: &Ruler, look: &mut Look, player: &mut Player) {
    // What ended while the ruler was hidden is not put back.
    if !ui.input(|input| input.pointer.any_down() || input.pointer.any_released()) {
        player.dragged = None;
    }
    // The toolkit ends the drag by the same key.
    if ui.input(|input| input.key_pressed(egui::Key::Escape))
        && let Some(HeldKey { before: (idx, keys), .. }) = player.dragged.take()
    {
        (look.timeline.keys, player.chosen) = (keys, Some(idx));
        return;
    }
    let Some(pointer) = response.interact_pointer_pos() else { return };
    if response.drag_started_by(PointerButton::Primary) || response.clicked() {
        response.request_focus();
    }
    if response.drag_started_by(PointerButton::Primary) {
        let press = ui.input(|input| input.pointer.press_origin()).unwrap_or(pointer);
        let held = taken(&look.timeline.keys, ruler, press, pointer);
        player.dragged = held.map(|idx| {
            // It stays under the pointer as it was taken: off its middle by as much.
            let off = ruler.x(look.timeline.keys[idx].secs) - press.x;
            HeldKey { idx, off, before: (idx, look.timeline.keys.clone()) }
        });
        player.chosen = held.or(player.chosen);
    }
    let is_dragged = response.dragged_by(PointerButton::Primary);
    let fps = look.timeline.fps;
    let on_frame = |x: f32| (ruler.secs_at(x) * fps).round() / fps;
    match &mut player.dragged {
        Some(held) if is_dragged => {
            held.idx = look.timeline.move_to(held.idx, on_frame(pointer.x + held.off));
            player.chosen = Some(held.idx);
        }
        None if (is_dragged || response.clicked()) && !look.timeline.keys.is_empty() => {
            (player.playhead, player.playing) = (Some(on_frame(pointer.x)), false);
        }
        _ => {}
    }
    if response.drag_stopped() {
        player.dragged = None;
    }
}

fn paint(ui: &Ui, (ruler, response): (&Ruler, &Response), timeline: &Timeline, player: &Player) {
    let (rect, painter) = (ruler.rect, ui.painter_at(ruler.rect));
    let visuals = ui.visuals();
    painter.rect_filled(rect, 3.0, visuals.extreme_bg_color);
    if response.has_focus() {
        painter.rect_stroke(rect, 3.0, visuals.selection.stroke, StrokeKind::Inside);
    }
    let (weak, y) = (visuals.weak_text_color(), rect.top() + LINE);
    let step = ruler.step();
    for mark in 0..=(ruler.secs / step) as u32 {
        let (secs, x) = (mark as f32 * step, ruler.x(mark as f32 * step));
        painter.vline(x, rect.top()..=rect.top() + 5.0, Stroke::new(1.0, weak));
        let words = if step < 1.0 { format!("{secs:.1} s") } else { format!("{secs:.0} s") };
        let words = painter.layout_no_wrap(words, FontId::proportional(10.5), weak);
        if x + 3.0 + words.size().x <= rect.right() {
            painter.galley(pos2(x + 3.0, rect.top() + 1.0), words, weak);
        }
    }
    for pair in timeline.keys.windows(2) {
        let [from, to] = [&pair[0], &pair[1]].map(|key| ruler.x(key.secs));
        let stroke = Stroke::new(if pair[0].look == pair[1].look { 1.0 } else { 2.5 }, weak);
        match pair[0].ease {
            Ease::Hold => {
                painter.extend(Shape::dashed_line(&[pos2(from, y), pos2(to, y)], stroke, 4.0, 4.0));
            }
            _ => drop(painter.hline(from..=to, y, stroke)),
        }
    }
    for (idx, key) in timeline.keys.iter().enumerate() {
        let center = pos2(ruler.x(key.secs), y);
        let diamond = [vec2(0.0, -6.0), vec2(6.0, 0.0), vec2(0.0, 6.0), vec2(-6.0, 0.0)].map(|corner| center + corner);
        let color = if player.chosen == Some(idx) { theme::ACCENT } else { visuals.text_color() };
        painter.add(Shape::convex_polygon(diamond.to_vec(), color, Stroke::new(1.0, Color32::from_black_alpha(160))));
        let font = FontId::proportional(11.0);
        painter.text(center + vec2(9.0, 7.0), Align2::LEFT_CENTER, in_row(&key.look), font, color);
    }
    if timeline.keys.is_empty() {
        let words = "Add keys to let one look become the next";
        painter.text(pos2(rect.center().x, y), Align2::CENTER_CENTER, words, FontId::proportional(12.0), weak);
    }
    if let Some(secs) = player.playhead {
        painter.vline(ruler.x(secs), rect.y_range(), Stroke::new(1.5, theme::ACCENT));
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    use super::*;

    #[test]
    fn it_plays_to_the_end_and_starts_over() {
        let mut timeline = Timeline::default();
        let mut player = Player::default();
        toggle(&mut player, &timeline);
        assert_eq!(player, Player::default(), "without keys there is nothing to play");
        timeline.add(Key { secs: 2.0, look: "A".into(), ease: Ease::Smooth });
        toggle(&mut player, &timeline);
        player.advance(&timeline, 1.5);
        assert_eq!((player.playhead, player.playing), (Some(1.5), true));
        player.advance(&timeline, 1.5);
        assert_eq!((player.playhead, player.playing), (Some(2.0), false));
        toggle(&mut player, &timeline);
        assert_eq!((player.playhead, player.playing), (Some(0.0), true));
        player.loops = true;
        player.advance(&timeline, 1.5);
        player.advance(&timeline, 1.5);
        assert_eq!((player.playhead, player.playing), (Some(1.0), true), "it begins again");
    }

    #[test]
    fn it_steps_from_frame_to_frame_within_its_keys() {
        let mut timeline = Timeline::default();
        let mut player = Player { playing: true, ..Player::default() };
        player.step(&timeline, 1.0);
        assert_eq!(player.playhead, None, "without keys there is nowhere to go");
        timeline.add(Key { secs: 2.0, look: "A".into(), ease: Ease::Smooth });
        player.step(&timeline, 1.0);
        assert_eq!((player.playhead, player.playing), (Some(1.0 / timeline.fps), false));
        player.step(&timeline, -10.0);
        assert_eq!(player.playhead, Some(0.0));
        player.step(&timeline, 1e6);
        assert_eq!(player.playhead, Some(2.0));
    }

    #[test]
    fn of_keys_at_one_time_the_way_of_a_drag_tells_which_is_taken() {
        let ruler = Ruler { rect: Rect::from_min_size(pos2(0.0, 0.0), vec2(624.0, HEIGHT)), secs: 6.0 };
        let key = |(secs, look): (f32, &str)| Key { secs, look: look.into(), ease: Ease::Smooth };
        let keys = [(0.0, "A"), (2.0, "B"), (2.0, "C"), (2.05, "D")].map(key);
        let drag = |from_x: f32, way: f32| taken(&keys, &ruler, pos2(from_x, LINE), pos2(from_x + way, LINE));
        let cut = ruler.x(2.0);
        assert_eq!([drag(cut, -8.0), drag(cut, 8.0)], [Some(1), Some(2)]);
        assert_eq!(drag(ruler.x(2.05), -8.0), Some(3), "the nearest one, though others are within reach");
        assert_eq!(drag(ruler.x(4.0), 8.0), None);
    }

    #[test]
    fn a_key_that_is_taken_beside_its_middle_goes_as_far_as_the_pointer() {
        let (mut look, player) = (Look::default(), Player::default());
        for secs in [0.0, 2.0] {
            look.timeline.add(Key { secs, look: "A".into(), ease: Ease::Smooth });
        }
        let track = |ui: &mut Ui, (look, player): &mut (Look, Player)| track_ui(ui, look, player);
        let mut window = Harness::builder().with_size(vec2(640.0, 100.0)).build_ui_state(track, (look, player));
        window.run_steps(2);
        let rect = window.get_by_label("Timeline ruler").rect();
        let points = Ruler { rect, secs: LEAST_SECS };
        let key = pos2(points.x(2.0), rect.top() + LINE);
        let from = key + vec2(5.0, 0.0);
        window.hover_at(from);
        window.run_steps(2);
        window.drag_at(from);
        window.run_steps(2);
        for secs in [2.25, 2.5] {
            let to = from + vec2(points.x(secs) - key.x, 0.0);
            window.hover_at(to);
            window.run_steps(2);
            let found = window.state().0.timeline.end_secs();
            assert!((found - secs).abs() < 1e-3, "{found} s for {secs} s");
        }
    }

    #[test]
    fn the_ruler_reads_what_it_shows() {
        let ruler = Ruler { rect: Rect::from_min_size(pos2(5.0, 0.0), vec2(624.0, 40.0)), secs: 6.0 };
        for secs in [0.0, 1.25, 6.0] {
            assert!((ruler.secs_at(ruler.x(secs)) - secs).abs() < 1e-4);
        }
        assert_eq!((ruler.step(), ruler.secs_at(-50.0)), (1.0, 0.0));
        let narrow = Ruler { rect: Rect::from_min_size(pos2(5.0, 0.0), vec2(9.0, 40.0)), secs: 99_000.0 };
        assert!(narrow.secs / narrow.step() < 20.0, "as good as no marks");
    }
}
