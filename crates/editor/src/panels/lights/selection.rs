//! Which rows are selected: by a click, with the command key one more, with Shift all up to there.

use std::collections::BTreeSet;

use eframe::egui::Modifiers;

/// Keys of the selected lights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    keys: BTreeSet<String>,
    /// Where a selection with Shift begins.
    anchor: Option<String>,
}

impl Selection {
    /// Whether a light is selected.
    pub fn has(&self, key: &str) -> bool {
        self.keys.contains(key)
    }

    /// Whether nothing is.
    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// The light that alone is selected.
    pub fn single(&self) -> Option<&str> {
        self.keys.first().filter(|_| self.keys.len() == 1).map(String::as_str)
    }

    /// Selects one light alone.
    pub fn set(&mut self, key: &str) {
        self.set_all([key.to_owned()]);
    }

    /// Selects some lights and no others.
    pub fn set_all(&mut self, keys: impl IntoIterator<Item = String>) {
        self.keys = keys.into_iter().collect();
        self.anchor = self.keys.first().cloned();
    }

    /// Selects one more light.
    pub fn add(&mut self, key: &str) {
        self.keys.insert(key.to_owned());
        self.anchor = Some(key.to_owned());
    }

    /// Selects nothing.
    pub fn clear(&mut self) {
        *self = Selection::default();
    }

    /// A click on a row; a second one on the only row that is selected lets it go. `order` are the keys as they are shown.
    pub fn click(&mut self, key: &str, modifiers: Modifiers, order: &[String]) {
        let at = |wanted: &str| order.iter().position(|key| key == wanted);
        let range = modifiers.shift.then(|| at(self.anchor.as_deref()?).zip(at(key))).flatten();
        if let Some((from, to)) = range {
            self.keys = order[from.min(to)..=from.max(to)].iter().cloned().collect();
        } else if modifiers.command {
            if !self.keys.remove(key) {
                self.keys.insert(key.to_owned());
            }
            self.anchor = Some(key.to_owned());
        } else if self.keys.len() == 1 && self.has(key) {
            self.clear();
        } else {
            self.set(key);
        }
    }

    /// A click on the row of a group.
    pub fn click_group(&mut self, keys: &[String], modifiers: Modifiers) {
        let is_all = keys.iter().all(|key| self.has(key));
        if modifiers.command || modifiers.shift {
            for key in keys {
                if is_all {
                    self.keys.remove(key)
                } else {
                    self.keys.insert(key.clone())
                };
            }
        } else if is_all && self.keys.len() == keys.len() {
            self.clear();
        } else {
            self.set_all(keys.iter().cloned());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clicks_select_one_more_or_all_up_to_there() {
        let order = ["a", "b", "c", "d"].map(str::to_owned);
        let mut selection = Selection::default();
        let mut click = |key: &str, modifiers| {
            selection.click(key, modifiers, &order);
            selection.keys.iter().cloned().collect::<String>()
        };
        assert_eq!(click("c", Modifiers::NONE), "c");
        assert_eq!(click("a", Modifiers::SHIFT), "abc");
        assert_eq!(click("d", Modifiers::SHIFT), "cd", "from where it began");
        assert_eq!(click("a", Modifiers::COMMAND), "acd");
        assert_eq!(click("c", Modifiers::COMMAND), "ad");
        assert_eq!(click("b", Modifiers::NONE), "b");
        assert_eq!(click("b", Modifiers::NONE), "");
        selection.set("a");
        selection.add("c");
        selection.add("a");
        assert!(selection.has("a") && selection.has("c") && selection.keys.len() == 2);
        selection.click_group(&order[..2], Modifiers::NONE);
        selection.click_group(&order[2..3], Modifiers::COMMAND);
        assert_eq!(selection.keys.len(), 3);
        selection.click_group(&order[..2], Modifiers::COMMAND);
        assert!(selection.has("c") && selection.keys.len() == 1);
    }
}
