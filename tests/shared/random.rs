//! Random numbers that a seed repeats.

/// A generator of random numbers: a linear congruence whose bits are mixed.
///
/// The files in `formats/examples` are made with it, so its numbers must stay what they are.
#[derive(Debug, Clone)]
pub struct Random(pub u64);

impl Random {
    /// Returns the next 64 random bits.
    #[allow(clippy::should_implement_trait, reason = "it has no end")]
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let mixed = (self.0 ^ self.0 >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed ^ mixed >> 32
    }

    /// Returns a number below `bound`, which is at least 1.
    pub fn below(&mut self, bound: u64) -> u64 {
        self.next() % bound
    }

    /// Returns an index into a slice of `len` elements.
    pub fn index(&mut self, len: usize) -> usize {
        usize::try_from(self.below(len as u64)).expect("it is below a usize")
    }

    /// Returns a number from 0 to 255.
    pub fn byte(&mut self) -> u8 {
        self.next().to_le_bytes()[0]
    }

    /// Returns a number from 0 up to, but not, 1.
    pub fn number(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Returns a unit vector; all directions are equally likely.
    pub fn direction(&mut self) -> [f64; 3] {
        let z = 2.0 * self.number() - 1.0;
        let (sin, cos) = (std::f64::consts::TAU * self.number()).sin_cos();
        let across = (1.0 - z * z).sqrt();
        [across * cos, across * sin, z]
    }

    /// Returns a point of a grid of `dims` points.
    pub fn place(&mut self, dims: [u32; 3]) -> [u32; 3] {
        dims.map(|points| u32::try_from(self.below(points.into())).expect("it is below a u32"))
    }
}
