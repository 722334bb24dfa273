//! What the keyboard comes to is scrolled into sight. The toolkit does that for text alone.

use eframe::egui::{Id, Ui};

/// Most parts of the window that lie one in the other.
const MOST_DEEP: usize = 100;

/// Called at the end of what a scroll area holds: shows what of it has just got the keyboard. What a press gave it to is seen already.
/// No other area has the same `name`.
pub fn keep_in_sight(ui: &Ui, name: &str) {
    let (own, focused) = (ui.unique_id(), ui.memory(|memory| memory.focused()));
    let kept = Id::unique(("in sight", name));
    let before = ui.data_mut(|data| std::mem::replace(data.get_temp_mut_or::<Option<Id>>(kept, None), focused));
    let is_pressed = ui.input(|input| input.pointer.any_down() || input.pointer.any_released());
    let Some(id) = focused.filter(|_| focused != before && !is_pressed) else { return };
    let place = ui.ctx().viewport(|viewport| {
        let widgets = &viewport.this_pass.widgets;
        let widget = widgets.get(id)?;
        let host_of = |host: &Id| widgets.get(*host).map(|host| host.parent_id);
        let mut hosts = std::iter::successors(Some(widget.parent_id), host_of).take(MOST_DEEP);
        hosts.any(|host| host == own).then_some(widget.rect)
    });
    if let Some(place) = place {
        ui.scroll_to_rect(place, None);
    }
}
