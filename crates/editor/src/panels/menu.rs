//! The menu of a thing: by a right click where the pointer is, or by a key of what has the focus.

use eframe::egui::{Context, Id, Key, KeyboardShortcut, Modifiers, Popup, Response, SetOpenCommand, Ui};

/// Keys that open the menu of what has the focus.
pub const MENU: KeyboardShortcut = KeyboardShortcut::new(Modifiers::SHIFT, Key::F10);
/// Keyboards with a key of its own have it beside the right Ctrl.
const MENU_TOO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::Menu);
/// Height from which a thing is so large that its menu stands in its middle, points.
const LARGE: f32 = 200.0;

/// Whether the menu of something is asked for by a key in this frame.
pub fn is_asked(response: &Response) -> bool {
    let is_pressed = |keys: &KeyboardShortcut| {
        response.ctx.input(|input| input.key_pressed(keys.logical_key) && input.modifiers == keys.modifiers)
    };
    response.has_focus() && (is_pressed(&MENU) || is_pressed(&MENU_TOO))
}

/// Has the menu of something drawn while it is open.
pub fn context_menu(response: &Response, add: impl FnOnce(&mut Ui)) {
    let (ctx, by_key) = (&response.ctx, response.id.with("menu by key"));
    let is_asked = is_asked(response);
    if !is_asked && !Popup::is_id_open(ctx, by_key) {
        response.context_menu(add);
        return;
    }
    let is_large = response.rect.height() > LARGE;
    let at = if is_large { response.rect.center() } else { response.rect.left_bottom() };
    let menu = Popup::menu(response).id(by_key).open_memory(is_asked.then_some(SetOpenCommand::Bool(true)));
    menu.at_position(at).show(add);
    // The keyboard goes on where it was.
    if !Popup::is_id_open(ctx, by_key) {
        response.request_focus();
    }
}

/// Notes as a frame begins whether a menu, a list or a picker is open, or the list of keys, which Escape closes before others hear of it;
/// or a text was typed that it gives up, which the toolkit has let go of by then.
pub fn note_open(ctx: &Context, are_keys_listed: bool) {
    let (is_open, is_typed) = (are_keys_listed || Popup::is_any_open(ctx), ctx.text_edit_focused());
    ctx.data_mut(|data| {
        let typed = data.get_temp_mut_or::<bool>(Id::unique("typed as the frame before began"), false);
        let was_typed = std::mem::replace(typed, is_typed);
        data.insert_temp(Id::unique("open as the frame began"), is_open || was_typed);
        data.insert_temp(Id::unique("keys are listed"), are_keys_listed);
    });
}

/// Whether the list of keys is open: what lies behind it waits with its keys.
pub fn are_keys_listed(ctx: &Context) -> bool {
    ctx.data(|data| data.get_temp(Id::unique("keys are listed"))).unwrap_or(false)
}

/// Whether one was open as this frame began, or a text was typed before it.
pub fn was_open(ctx: &Context) -> bool {
    ctx.data(|data| data.get_temp(Id::unique("open as the frame began"))).unwrap_or(false)
}
