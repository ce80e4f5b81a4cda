//! One row of the design matrix: the non-zero derivatives of one observation in one band.

/// (unknown, derivative), in the order in which terms push them.
#[derive(Default)]
pub struct Row {
    entries: Vec<(usize, f64)>,
    first: usize,
}

impl Row {
    /// Removes all entries.
    pub fn clear(&mut self) {
        self.entries.clear();
    }

    /// Sets the first unknown of the term that pushes next.
    pub fn begin_term(&mut self, first: usize) {
        self.first = first;
    }

    /// Adds the derivative by a term's own unknown, counted from the term's first.
    pub fn push(&mut self, unknown: usize, derivative: f64) {
        self.entries.push((self.first + unknown, derivative));
    }

    /// Product with the vector of unknowns.
    pub fn dot(&self, values: &[f64]) -> f64 {
        self.entries.iter().map(|(unknown, derivative)| derivative * values[*unknown]).sum()
    }
}

impl std::ops::Deref for Row {
    type Target = [(usize, f64)];
    fn deref(&self) -> &[(usize, f64)] {
        &self.entries
    }
}
