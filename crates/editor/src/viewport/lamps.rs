//! Free lamps in the picture: handles that are clicked, dragged along axes, planes and surfaces, and aimed.

use clerestory_transport::lamps::{FreeLamp, LampShape};
use clerestory_transport::light::LightRig;
use eframe::egui::accesskit::{self, Role};
use eframe::egui::{
    self, Align2, Color32, Context, CursorIcon, FontId, Id, Key, Painter, PointerButton, Pos2, Rect, Response, Sense,
    Shape, Stroke, Ui, Vec2, vec2,
};
use glam::Vec3;

use super::gizmo::{AXES, AXIS_NAMES, AimWhileMoving, Drag, Held, Part, Sight, aim_at, move_to};
use crate::action::Action;
use crate::look::Look;
use crate::panels::arrows::{FINE, arrows};
use crate::panels::lamps::{LampState, Pick, lamp_menu, shown_color};
use crate::panels::lights::{LightsState, letters_menu};
use crate::panels::menu::context_menu;
use crate::panels::shortcuts::{escapes, hears_keys};
use crate::theme;

/// Length of the arrows in points.
const ARROW: f32 = 66.0;
/// Where the handles of the planes are, in lengths of the arrows along both axes.
const PLANE_AT: f32 = 0.38;
/// Half a side of what is taken hold of, points.
const REACH: f32 = 8.0;
/// Arrows whose tips are nearer to the lamp than this point at the eye and are left out, points.
const FORESHORTENED: f32 = 20.0;
/// How far an arrow key takes a handle, points.
const KEY_STEP: f32 = 6.0;
/// What is beside the words of a hint, and their least width, points.
const BESIDE_HINT: f32 = 26.0;
const LEAST_HINT: f32 = 160.0;
/// Half the width of what is read under the pointer, in the middle below, and the height of it and of what stands over it, points.
const HALF_READING: f32 = 150.0;
const READINGS: f32 = 62.0;
/// Colors of the axes.
const AXIS_COLORS: [Color32; 3] =
    [Color32::from_rgb(226, 92, 84), Color32::from_rgb(118, 186, 92), Color32::from_rgb(88, 146, 232)];

/// Draws the handles and does what is done to them. `picture` is the response of the picture behind them. Answers whether a
/// click was about them.
pub fn lamps_ui(
    ui: &mut Ui,
    picture: &Response,
    sight: &Sight,
    look: &mut Look,
    lights: &mut LightsState,
    actions: &mut Vec<Action>,
) -> bool {
    let painter = ui.painter_at(picture.rect.intersect(sight.image));
    let (names, rig) = (&look.names, &mut look.lights);
    let name_of = |lamp: &FreeLamp| names.get(&lamp.key).unwrap_or(&lamp.key).clone();
    let aimed = lights.lamps.chosen.as_deref().filter(|_| lights.lamps.aiming);
    let others = aimed.map_or_else(Vec::new, |key| selected_with(key, &rig.lamps, lights));
    let was_held = lights.lamps.drag.is_some();
    let state = &mut lights.lamps;
    let mut touched = aim_by_click(ui, picture, sight, (&mut rig.lamps, &others), state, &name_of);
    cancel(ui, &mut rig.lamps, state, actions);
    hold_pulled(sight, &rig.lamps, state);
    drag_on(ui, sight, &mut rig.lamps, state);
    // The chosen lamp comes last, and so lies on top.
    let mut order: Vec<usize> = (0..rig.lamps.len()).collect();
    order.sort_by_key(|idx| lights.lamps.is_chosen(&rig.lamps[*idx].key));
    for idx in order {
        let lamp = rig.lamps[idx].clone();
        let Some(center) = sight.seen_at(lamp.position).filter(|center| painter.clip_rect().contains(*center)) else {
            continue;
        };
        let (is_chosen, name) = (lights.lamps.is_chosen(&lamp.key), name_of(&lamp));
        if is_chosen {
            paint_shape(&painter, sight, &lamp);
        }
        if is_chosen && !lights.lamps.aiming {
            for (part, at) in parts(sight, &lamp, center) {
                let of = (&lamp, name.as_str());
                let held = (rig.lamps.as_mut_slice(), &mut lights.lamps);
                touched |= part_ui(ui, &painter, (sight, picture), (part, at, center), of, held);
            }
        }
        touched |= body_ui(ui, &painter, (sight, picture), center, (&lamp, &name), (rig, lights), actions);
        // By keys, too, what is selected with it goes along.
        let way = rig.lamps[idx].position - lamp.position;
        if way != Vec3::ZERO {
            let others = selected_with(&lamp.key, &rig.lamps, lights);
            carry(&mut rig.lamps, &others, way, lights.lamps.aim_while_moving);
        }
    }
    if let Some(drag) = lights.lamps.drag.as_ref().filter(|_| !was_held) {
        let carried = selected_with(&drag.key, &rig.lamps, lights);
        lights.lamps.carried = carried;
    }
    let adds = ui.input(|input| Pick::of(input.modifiers)) == Pick::Another;
    if picture.clicked() && !touched && !lights.lamps.aiming && !adds {
        // With handles on the screen a click beside them puts them away, and that is all.
        touched |= rig.lamps.iter().any(|lamp| lights.lamps.is_chosen(&lamp.key));
        lights.lamps.chosen = None;
    }
    touched || lights.lamps.aiming
}

/// The other lamps that are selected where a lamp is selected as well.
fn selected_with(key: &str, lamps: &[FreeLamp], lights: &LightsState) -> Vec<FreeLamp> {
    if !lights.is_selected(key) {
        return Vec::new();
    }
    lamps.iter().filter(|lamp| lamp.key != key && lights.is_selected(&lamp.key)).cloned().collect()
}

/// Pixels of the film at a place on the screen.
pub(super) fn film_px(sight: &Sight, at: Pos2) -> [f32; 2] {
    let px = (at - sight.image.min) / sight.image.size() * vec2(sight.film.width as f32, sight.film.height as f32);
    [px.x, px.y]
}

/// While lamps are to be aimed, the chosen one and `others` that are selected with it, a click says at what. Answers whether one did.
fn aim_by_click(
    ui: &Ui,
    picture: &Response,
    sight: &Sight,
    (lamps, others): (&mut [FreeLamp], &[FreeLamp]),
    state: &mut LampState,
    name_of: &impl Fn(&FreeLamp) -> String,
) -> bool {
    let Some(chosen) = lamps.iter().find(|lamp| state.is_chosen(&lamp.key) && lamp.shape.is_aimed()) else {
        state.aiming = false;
        return false;
    };
    if !state.aiming {
        return false;
    }
    if let Some(at) = picture.hover_pos() {
        ui.ctx().set_cursor_icon(CursorIcon::Crosshair);
        let n_more = others.iter().filter(|lamp| lamp.shape.is_aimed()).count();
        let who = match n_more {
            0 => format!("{} is", name_of(chosen)),
            _ => format!("{} and {n_more} more are", name_of(chosen)),
        };
        hint(ui, picture.rect, &format!("Click what {who} to light, Esc to leave it"));
        if picture.clicked_by(PointerButton::Primary)
            && let Some(surface) = sight.surface(at)
        {
            for lamp in lamps.iter_mut().filter(|lamp| lamp.shape.is_aimed()) {
                if state.is_chosen(&lamp.key) || others.iter().any(|other| other.key == lamp.key) {
                    aim_at(lamp, surface.position);
                }
            }
            state.aiming = false;
            return true;
        }
    }
    false
}

/// Esc puts dragged lamps back, one that was pulled out of the file into it, and ends aiming.
fn cancel(ui: &Ui, lamps: &mut [FreeLamp], state: &mut LampState, actions: &mut Vec<Action>) {
    if !ui.input(|input| input.key_pressed(Key::Escape)) {
        return;
    }
    // What the same key closes in front, or gives up of a text, leaves a lamp that is to be aimed in hand; a drag is ended by the toolkit
    // all the same.
    state.aiming &= !escapes(ui);
    if let Some(pulled) = state.pulled.take() {
        state.pulled_at = None;
        actions.push(Action::PutBack(Box::new(pulled)));
    }
    if let Some(drag) = state.drag.take() {
        for before in state.carried.drain(..).chain([drag.before]) {
            if let Some(lamp) = lamps.iter_mut().find(|lamp| lamp.key == before.key) {
                *lamp = before;
            }
        }
    }
}

/// The handles around a chosen lamp, and where they are.
fn parts(sight: &Sight, lamp: &FreeLamp, center: Pos2) -> Vec<(Part, Pos2)> {
    let mut parts = Vec::new();
    let Some(length) = sight.meters_per_point(lamp.position).map(|meters| meters * ARROW) else { return parts };
    let seen = |offset: Vec3| sight.seen_at(lamp.position + offset * length);
    let forward = sight.direction(center);
    for axis in 0..3 {
        let [a, b] = [AXES[(axis + 1) % 3], AXES[(axis + 2) % 3]];
        if let Some(at) = seen((a + b) * PLANE_AT).filter(|_| AXES[axis].dot(forward).abs() > 0.2) {
            parts.push((Part::Plane(axis), at));
        }
        if let Some(at) = seen(AXES[axis]).filter(|at| at.distance(center) > FORESHORTENED) {
            parts.push((Part::Axis(axis), at));
        }
    }
    if lamp.shape.is_aimed()
        && let Some(at) = sight.seen_at(lamp.aim).filter(|at| at.distance(center) > FORESHORTENED)
    {
        parts.push((Part::Aim, at));
    }
    parts
}

/// What a part does, for people.
fn part_words(part: Part, name: &str) -> String {
    match part {
        Part::Axis(axis) => format!("Move {name} along {}", AXIS_NAMES[axis]),
        Part::Plane(axis) => format!("Move {name} across {}", AXIS_NAMES[axis]),
        Part::Body => format!("Move {name} over surfaces"),
        Part::Aim => format!("Aim {name}"),
    }
}

/// A handle of the chosen lamp; answers whether it is under the pointer.
fn part_ui(
    ui: &Ui,
    painter: &Painter,
    (sight, picture): (&Sight, &Response),
    (part, at, center): (Part, Pos2, Pos2),
    (lamp, name): (&FreeLamp, &str),
    (lamps, state): (&mut [FreeLamp], &mut LampState),
) -> bool {
    let words = part_words(part, name);
    let response = handle(ui, at, Id::unique(("lamp part", part_words(part, &lamp.key))), &words);
    nudge(ui, &response, sight, (lamp, part), lamps, state.aim_while_moving);
    let is_held = state.drag.as_ref().is_some_and(|drag| drag.key == lamp.key && drag.part == part);
    paint_part(painter, (part, at, center), if response.hovered() || is_held { 1.0 } else { 0.75 });
    take_hold(ui, [&response, picture], sight, part, lamp, state) || response.hovered() || response.clicked()
}

/// The lamp itself: a click chooses it, a drag moves it over surfaces. Answers whether it is under the pointer.
fn body_ui(
    ui: &Ui,
    painter: &Painter,
    (sight, picture): (&Sight, &Response),
    center: Pos2,
    (lamp, name): (&FreeLamp, &str),
    (rig, lights): (&mut LightRig, &mut LightsState),
    actions: &mut Vec<Action>,
) -> bool {
    let is_selected = lights.is_selected(&lamp.key);
    let state = &mut lights.lamps;
    let is_chosen = state.is_chosen(&lamp.key);
    let rim = if is_chosen || is_selected { theme::ACCENT } else { Color32::from_gray(235) };
    if state.aiming {
        // The next click is about what is to be lit, whatever lamp is seen before it.
        paint_body(painter, (center, 6.0), lamp, rim);
        return false;
    }
    let words = if is_chosen { part_words(Part::Body, name) } else { format!("{name} in the picture") };
    let response = handle(ui, center, Id::unique(("lamp", lamp.key.as_str())), &words);
    nudge(ui, &response, sight, (lamp, Part::Body), &mut rig.lamps, state.aim_while_moving);
    paint_body(painter, (center, if response.hovered() { 7.0 } else { 6.0 }), lamp, rim);
    let is_held = take_hold(ui, [&response, picture], sight, Part::Body, lamp, state);
    if response.clicked() {
        state.picked = Some((lamp.key.clone(), Pick::of(ui.input(|input| input.modifiers))));
    }
    if response.secondary_clicked() && is_selected {
        // Its menu is for what is selected with it, which stays so.
        state.picked = Some((lamp.key.clone(), Pick::Another));
    }
    if response.clicked() || is_held || response.secondary_clicked() {
        state.chosen = Some(lamp.key.clone());
    }
    if response.hovered() && state.drag.is_none() {
        hint(ui, painter.clip_rect(), &format!("{name}, drag to move it over surfaces, with Alt freely"));
    }
    context_menu(&response, |ui| {
        letters_menu(ui, &lamp.key, rig, &mut lights.solo);
        lamp_menu(ui, lamp, state, actions);
    });
    is_held || response.hovered() || response.clicked()
}

fn handle(ui: &Ui, at: Pos2, id: Id, words: &str) -> Response {
    let rect = Rect::from_center_size(at, Vec2::splat(2.0 * REACH));
    let response = ui.interact(rect, id, Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, ui.is_enabled(), words));
    if response.hovered() {
        ui.ctx().set_cursor_icon(CursorIcon::Grab);
    }
    theme::keyboard_frame(ui, &response);
    response
}

/// Arrow keys take the handle that has the keyboard over the screen, with Shift a tenth of the way, and its lamp as a drag would.
fn nudge(
    ui: &Ui,
    handle: &Response,
    sight: &Sight,
    (lamp, part): (&FreeLamp, Part),
    lamps: &mut [FreeLamp],
    aim: AimWhileMoving,
) {
    if !hears_keys(ui) {
        return;
    }
    let travel = arrows(ui, handle, FINE) * KEY_STEP;
    let own = lamps.iter_mut().find(|other| other.key == lamp.key);
    if let Some(own) = own.filter(|_| travel != Vec2::ZERO) {
        let mut drag = Drag::begin(sight, lamp, part, handle.rect.center());
        *own = drag.moved(sight, lamp, travel, Held { aim, ..Held::default() });
    }
}

/// Begins a drag of a part that was pressed. Where frames are slow, press and travel come at once, and then it is the
/// picture behind that seems to be dragged: what counts is where the press was.
fn take_hold(
    ui: &Ui,
    [handle, picture]: [&Response; 2],
    sight: &Sight,
    part: Part,
    lamp: &FreeLamp,
    state: &mut LampState,
) -> bool {
    let pressed = ui.input(|input| input.pointer.press_origin()).unwrap_or(handle.rect.center());
    let of_handle = handle.drag_started_by(PointerButton::Primary);
    let of_picture = picture.drag_started_by(PointerButton::Primary) && handle.rect.contains(pressed);
    if state.drag.is_some() || state.aiming || !(of_handle || of_picture) {
        return false;
    }
    state.drag = Some(Drag::begin(sight, lamp, part, pressed));
    state.dragged_to = Some(pressed);
    true
}

/// Takes hold of a lamp that was pulled out of the file a moment ago.
fn hold_pulled(sight: &Sight, lamps: &[FreeLamp], state: &mut LampState) {
    let Some(at) = state.pulled_at.take() else { return };
    if let Some(lamp) = lamps.iter().find(|lamp| state.is_chosen(&lamp.key)) {
        state.drag = Some(Drag::begin(sight, lamp, Part::Body, at));
        state.dragged_to = Some(at);
    }
}

/// Carries a lamp on that is held, with those that go along, and lets go of them where the button comes up.
fn drag_on(ui: &Ui, sight: &Sight, lamps: &mut [FreeLamp], state: &mut LampState) {
    let (pointer, is_down, modifiers) =
        ui.input(|input| (input.pointer.interact_pos(), input.pointer.primary_down(), input.modifiers));
    state.pulled.take_if(|_| !is_down);
    let Some(drag) = &mut state.drag else { return };
    let idx = lamps.iter().position(|lamp| lamp.key == drag.key);
    if let (Some(idx), Some(at), Some(last)) = (idx, pointer, state.dragged_to)
        && at != last
    {
        let held = Held { fine: modifiers.shift, free: modifiers.alt, aim: state.aim_while_moving };
        lamps[idx] = drag.moved(sight, &lamps[idx], at - last, held);
        let way = lamps[idx].position - drag.before.position;
        carry(lamps, &state.carried, way, held.aim);
        state.dragged_to = Some(at);
    }
    ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
    if is_down {
        ui.ctx().request_repaint();
    } else {
        state.let_go();
    }
}

/// Puts lamps so far from where they were.
fn carry(lamps: &mut [FreeLamp], before: &[FreeLamp], way: Vec3, aim: AimWhileMoving) {
    for lamp in lamps {
        if let Some(was) = before.iter().find(|was| was.key == lamp.key) {
            *lamp = was.clone();
            move_to(lamp, was.position + way, aim);
        }
    }
}

fn paint_part(painter: &Painter, (part, at, center): (Part, Pos2, Pos2), strength: f32) {
    let dark = Color32::from_black_alpha(120);
    match part {
        Part::Axis(axis) => {
            let color = AXIS_COLORS[axis].gamma_multiply(strength);
            let direction = (at - center).normalized();
            let (start, tip) = (center + direction * 10.0, at + direction * 7.0);
            painter.line_segment([start, at], Stroke::new(4.0, dark));
            painter.line_segment([start, at], Stroke::new(2.0, color));
            let side = direction.rot90() * 5.0;
            painter.add(Shape::convex_polygon(vec![tip, at + side, at - side], color, Stroke::NONE));
        }
        Part::Plane(axis) => {
            let rect = Rect::from_center_size(at, Vec2::splat(10.0));
            painter.rect_filled(rect, 2.0, AXIS_COLORS[axis].gamma_multiply(0.7 * strength));
            painter.rect_stroke(rect, 2.0, Stroke::new(1.0, dark), egui::StrokeKind::Outside);
        }
        Part::Aim => {
            let color = theme::ACCENT.gamma_multiply(strength);
            painter.extend(Shape::dashed_line(&[center, at], Stroke::new(1.2, color.gamma_multiply(0.7)), 5.0, 4.0));
            for (width, color) in [(3.5, dark), (1.6, color)] {
                painter.circle_stroke(at, 6.5, Stroke::new(width, color));
            }
            painter.circle_filled(at, 2.0, color);
        }
        Part::Body => {}
    }
}

fn paint_body(painter: &Painter, (center, radius): (Pos2, f32), lamp: &FreeLamp, rim: Color32) {
    let fill = if lamp.setting.muted { Color32::from_gray(70) } else { shown_color(lamp) };
    painter.circle_filled(center, radius + 2.5, Color32::from_black_alpha(130));
    painter.circle(center, radius, fill, Stroke::new(2.0, rim));
}

/// The outline of a lamp that has a size, and the cone of a spot.
fn paint_shape(painter: &Painter, sight: &Sight, lamp: &FreeLamp) {
    let [right, up, ahead] = lamp.frame();
    let ring = |center: Vec3, radius: f32, u: Vec3, v: Vec3| -> Vec<Vec3> {
        let angles = (0..48).map(|i| i as f32 / 48.0 * std::f32::consts::TAU);
        angles.map(|angle| center + (u * angle.cos() + v * angle.sin()) * radius).collect()
    };
    let outline = match lamp.shape {
        LampShape::Rectangle { size_m: [width, height] } => [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
            .map(|(x, y)| lamp.position + right * (0.5 * width * x) + up * (0.5 * height * y))
            .to_vec(),
        LampShape::Disk { radius_m } => ring(lamp.position, radius_m, right, up),
        LampShape::Sphere { radius_m } => {
            let [u, v] = [sight.camera.world_from_camera.x_axis, sight.camera.world_from_camera.y_axis];
            ring(lamp.position, radius_m, u.truncate(), v.truncate())
        }
        LampShape::Spot { outer_rad, .. } => {
            // A wider cone would be drawn as a plane without end.
            let length = lamp.aim.distance(lamp.position).min(0.5 * sight.scene.diameter());
            ring(lamp.position + ahead * length, length * outer_rad.min(1.2).tan(), right, up)
        }
        _ => return,
    };
    let seen: Option<Vec<Pos2>> = outline.into_iter().map(|point| sight.seen_at(point)).collect();
    if let Some(seen) = seen {
        painter.add(Shape::closed_line(seen.clone(), Stroke::new(3.0, Color32::from_black_alpha(90))));
        painter.add(Shape::closed_line(seen, Stroke::new(1.3, theme::ACCENT.gamma_multiply(0.8))));
    }
}

/// A line of words at the lower left; more of them where the area is narrow.
pub(super) fn hint(ui: &Ui, area: Rect, words: &str) {
    let painter = ui.painter();
    let (font, most) = (FontId::proportional(12.5), (area.width() - BESIDE_HINT).max(LEAST_HINT));
    let galley = painter.layout(words.to_owned(), font, Color32::from_gray(230), most);
    let place = hint_place(area, galley.size());
    painter.rect_filled(place.expand2(vec2(7.0, 4.0)), 4.0, Color32::from_black_alpha(170));
    painter.galley(place.min, galley, Color32::WHITE);
    tell(ui.ctx(), Id::unique("picture hint"), (Role::Status, words), place);
}

/// Where a hint of some size lies: at the lower left, and above what is read under the pointer where it would reach that.
fn hint_place(area: Rect, size: Vec2) -> Rect {
    let place = |above: f32| Align2::LEFT_BOTTOM.anchor_size(area.left_bottom() + vec2(12.0, -10.0 - above), size);
    let low = place(0.0);
    if low.right() > area.center().x - HALF_READING { place(READINGS) } else { low }
}

/// Tells those who read the window with other means of what is only painted.
pub(super) fn tell(ctx: &Context, id: Id, (role, words): (Role, &str), place: Rect) {
    ctx.accesskit_node_builder(id, |node| {
        node.set_role(role);
        node.set_label(words);
        let [x0, y0, x1, y1] = [place.min.x, place.min.y, place.max.x, place.max.y].map(f64::from);
        node.set_bounds(accesskit::Rect { x0, y0, x1, y1 });
    });
}

#[cfg(test)]
mod tests {
    use eframe::egui::pos2;

    use super::*;

    #[test]
    fn a_hint_lies_beside_what_is_read_under_the_pointer_or_above_it() {
        let size = vec2(240.0, 16.0);
        let area = |width: f32| Rect::from_min_size(pos2(410.0, 40.0), vec2(width, 740.0));
        for width in [400.0, 690.0, 1200.0] {
            let (area, place) = (area(width), hint_place(area(width), size));
            let reading = Rect::from_center_size(area.center_bottom() - vec2(0.0, 36.0), vec2(260.0, 52.0));
            assert!(!place.expand2(vec2(7.0, 4.0)).intersects(reading), "{place} over {reading}");
            assert!(area.contains_rect(place));
        }
        assert_eq!(hint_place(area(1200.0), size).bottom(), area(1200.0).bottom() - 10.0);
    }
}
