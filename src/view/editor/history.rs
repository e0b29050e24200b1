//! Undo and redo.

/// The states of something that is edited: one now, those before it, and those that were undone.
#[derive(Debug, Clone)]
pub struct History<T> {
    past: Vec<T>,
    /// The state now.
    pub now: T,
    future: Vec<T>,
}

/// The most states that can be undone.
const MOST: usize = 200;

impl<T: Clone + PartialEq> History<T> {
    /// Begins a history.
    pub fn new(now: T) -> History<T> {
        History { past: Vec::new(), now, future: Vec::new() }
    }

    /// Remembers `before`, the state before the change that has just ended.
    pub fn changed_from(&mut self, before: T) {
        if before == self.now {
            return;
        }
        self.past.push(before);
        if self.past.len() > MOST {
            self.past.remove(0);
        }
        self.future.clear();
    }

    /// Returns whether there is something to undo.
    pub fn can_undo(&self) -> bool {
        !self.past.is_empty()
    }

    /// Returns whether there is something to redo.
    pub fn can_redo(&self) -> bool {
        !self.future.is_empty()
    }

    /// Goes back to the state before the last change, if there was one.
    pub fn undo(&mut self) {
        if let Some(before) = self.past.pop() {
            self.future.push(std::mem::replace(&mut self.now, before));
        }
    }

    /// Takes back the last undo.
    pub fn redo(&mut self) {
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
        for next in 2..=4 {
            let before = std::mem::replace(&mut history.now, next);
            history.changed_from(before);
        }
        history.undo();
        history.undo();
        assert_eq!((history.now, history.can_redo()), (2, true));
        history.redo();
        assert_eq!(history.now, 3);
        let before = std::mem::replace(&mut history.now, 9);
        history.changed_from(before);
        assert!(!history.can_redo());
        history.undo();
        assert_eq!(history.now, 3);
    }

    #[test]
    fn a_change_that_ends_where_it_began_is_none() {
        let mut history = History::new(1);
        history.changed_from(1);
        assert!(!history.can_undo());
    }
}
