//! Undo and redo.

/// The states of something that is edited: one now, those before it, and those that were undone.
#[derive(Debug, Clone)]
pub struct History<T> {
    past: Vec<T>,
    /// The state now.
    pub now: T,
    future: Vec<T>,
    /// The state before the change that goes on.
    begun: Option<T>,
}

/// The most states that can be undone.
const MOST: usize = 200;

impl<T: Clone + PartialEq> History<T> {
    /// Begins a history.
    pub fn new(now: T) -> History<T> {
        History { past: Vec::new(), now, future: Vec::new(), begun: None }
    }

    /// Notes what a frame changed. `before`: the state when it began; `goes_on`: whether the user still drags or types, so that
    /// later changes belong to this one.
    pub fn follow(&mut self, before: T, goes_on: bool) {
        if self.begun.is_none() && before != self.now {
            self.begun = Some(before);
        }
        if !goes_on {
            self.end_change();
        }
    }

    /// Replaces the state; that is one change.
    pub fn set(&mut self, now: T) {
        self.end_change();
        let before = std::mem::replace(&mut self.now, now);
        self.follow(before, false);
    }

    /// Ends the change that goes on; one that ends where it began is none.
    fn end_change(&mut self) {
        let Some(before) = self.begun.take().filter(|before| *before != self.now) else { return };
        self.past.push(before);
        if self.past.len() > MOST {
            self.past.remove(0);
        }
        self.future.clear();
    }

    /// Returns whether there is something to undo.
    pub fn can_undo(&self) -> bool {
        !self.past.is_empty() || self.begun.as_ref().is_some_and(|before| *before != self.now)
    }

    /// Returns whether there is something to redo.
    pub fn can_redo(&self) -> bool {
        !self.future.is_empty()
    }

    /// Goes back to the state before the last change, if there was one.
    pub fn undo(&mut self) {
        self.end_change();
        if let Some(before) = self.past.pop() {
            self.future.push(std::mem::replace(&mut self.now, before));
        }
    }

    /// Takes back the last undo.
    pub fn redo(&mut self) {
        self.end_change();
        if let Some(after) = self.future.pop() {
            self.past.push(std::mem::replace(&mut self.now, after));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn undo_and_redo_walk_through_the_changes() {
        let mut history = History::new(1);
        (2..=4).for_each(|next| history.set(next));
        history.undo();
        history.undo();
        assert_eq!((history.now, history.can_redo()), (2, true));
        history.redo();
        assert_eq!(history.now, 3);
        history.set(9);
        assert!(!history.can_redo());
        history.undo();
        assert_eq!(history.now, 3);
    }

    #[test]
    fn a_change_that_ends_where_it_began_is_none() {
        let mut history = History::new(1);
        history.set(1);
        assert!(!history.can_undo());
        for (now, goes_on) in [(2, true), (1, false)] {
            let before = std::mem::replace(&mut history.now, now);
            history.follow(before, goes_on);
            assert_eq!(history.can_undo(), goes_on);
        }
    }

    #[test]
    fn undo_takes_back_all_of_a_change_that_goes_on() {
        let mut history = History::new(1);
        for now in [2, 3] {
            let before = std::mem::replace(&mut history.now, now);
            history.follow(before, true);
        }
        history.undo();
        assert_eq!((history.now, history.can_undo(), history.can_redo()), (1, false, true));
    }
}
