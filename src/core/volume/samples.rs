//! Samples of the eight supported types, in native-endian buffers.

use bytemuck::Pod;
use serde::{Deserialize, Serialize};

use crate::with_samples;

/// The type of a volume's samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "the names are Rust's own")]
pub enum SampleType {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
}

impl SampleType {
    /// Returns the size of one sample in bytes.
    pub const fn bytes(self) -> usize {
        self.bits() as usize / 8
    }

    /// Returns the size of one sample in bits.
    pub const fn bits(self) -> u32 {
        match self {
            SampleType::U8 | SampleType::I8 => 8,
            SampleType::U16 | SampleType::I16 => 16,
            SampleType::U32 | SampleType::I32 | SampleType::F32 => 32,
            SampleType::F64 => 64,
        }
    }

    /// Returns the lowest and highest value of an integer type; `None` for floating-point types.
    pub const fn integer_range(self) -> Option<(f64, f64)> {
        match self {
            SampleType::U8 => Some((0.0, 255.0)),
            SampleType::I8 => Some((-128.0, 127.0)),
            SampleType::U16 => Some((0.0, 65_535.0)),
            SampleType::I16 => Some((-32_768.0, 32_767.0)),
            SampleType::U32 => Some((0.0, 4_294_967_295.0)),
            SampleType::I32 => Some((-2_147_483_648.0, 2_147_483_647.0)),
            SampleType::F32 | SampleType::F64 => None,
        }
    }
}

/// A Rust number type that samples can have.
pub trait Sample: Pod + PartialOrd + Send + Sync {
    /// The [`SampleType`] of this number type.
    const TYPE: SampleType;
    /// Converts the sample to double precision; exact for every supported type.
    fn to_f64(self) -> f64;
    /// Returns the sample's bits as a table index, if the type has 8 or 16 bits.
    fn small_bits(self) -> Option<usize>;
    /// Wraps the samples in a [`Samples`] buffer.
    fn into_samples(samples: Vec<Self>) -> Samples;
    /// Returns the buffer as a slice of this type; `None` if the buffer holds another type.
    fn slice_of(samples: &Samples) -> Option<&[Self]>;
    /// The lowest and the highest finite number of this type.
    const ENDS: [Self; 2];
    /// Returns a sample close to `value` that is not above it; the lowest sample if there is none.
    fn below(value: f64) -> Self;
    /// Returns a sample close to `value` that is not below it; the highest sample if there is none.
    fn above(value: f64) -> Self;
}

macro_rules! samples {
    ($($variant:ident $type:ty),*) => {
        $(impl Sample for $type {
            const TYPE: SampleType = SampleType::$variant;
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn small_bits(self) -> Option<usize> {
                match *bytemuck::bytes_of(&self) {
                    [a] => Some(usize::from(a)),
                    [a, b] => Some(usize::from(u16::from_ne_bytes([a, b]))),
                    _ => None,
                }
            }
            fn into_samples(samples: Vec<$type>) -> Samples {
                Samples::$variant(samples)
            }
            fn slice_of(samples: &Samples) -> Option<&[$type]> {
                match samples {
                    Samples::$variant(samples) => Some(samples),
                    _ => None,
                }
            }
            const ENDS: [$type; 2] = [<$type>::MIN, <$type>::MAX];
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::unnecessary_cast, reason = "saturates")]
            fn below(value: f64) -> $type {
                let near = value as $type;
                // The cast may round upward, but by less than the number that is subtracted here.
                if f64::from(near) > value { (value - value.abs() * 1e-6 - 1.0) as $type } else { near }
            }
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::unnecessary_cast, reason = "saturates")]
            fn above(value: f64) -> $type {
                let near = value as $type;
                if f64::from(near) < value { (value + value.abs() * 1e-6 + 1.0) as $type } else { near }
            }
        })*

        impl SampleType {
            /// All types, in declaration order.
            pub const ALL: [SampleType; 8] = [$(SampleType::$variant),*];

            /// Returns the type's name: "u8", "i16", "f32" and so on.
            pub const fn name(self) -> &'static str {
                match self {
                    $(SampleType::$variant => stringify!($type)),*
                }
            }
        }

        /// A native-endian buffer of samples of one type.
        #[derive(Debug, Clone, PartialEq)]
        #[expect(missing_docs, reason = "the names are Rust's own")]
        pub enum Samples {
            $($variant(Vec<$type>)),*
        }

        impl Samples {
            /// Creates a buffer of `len` zeros of type `ty`.
            pub fn zeros(ty: SampleType, len: usize) -> Samples {
                match ty {
                    $(SampleType::$variant => Samples::$variant(vec![<$type>::default(); len])),*
                }
            }

            /// Returns the type of the samples.
            pub fn sample_type(&self) -> SampleType {
                match self {
                    $(Samples::$variant(_) => SampleType::$variant),*
                }
            }
        }
    };
}

samples!(U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, F32 f32, F64 f64);

impl Samples {
    /// Returns the number of samples.
    pub fn len(&self) -> usize {
        with_samples!(self, samples => samples.len())
    }

    /// Returns the buffer's bytes for a reader to fill.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        with_samples!(self, samples => bytemuck::cast_slice_mut(samples))
    }

    /// Returns the buffer's bytes in native order.
    pub fn bytes(&self) -> &[u8] {
        with_samples!(self, samples => bytemuck::cast_slice(samples))
    }

    /// Returns sample `index` in double precision.
    ///
    /// # Panics
    /// If `index` is not below [`Samples::len`].
    pub fn get(&self, index: usize) -> f64 {
        with_samples!(self, samples => samples[index].to_f64())
    }

    /// Returns whether the buffer has no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Reverses the bytes of each sample, for files of the other endianness.
    pub fn swap_bytes(&mut self) {
        let width = self.sample_type().bytes();
        for sample in self.bytes_mut().chunks_exact_mut(width) {
            sample.reverse();
        }
    }
}

/// Runs `$body` with `$slice` bound to the typed slice inside a [`Samples`]; compiles `$body` once per type.
#[doc(hidden)]
#[macro_export]
macro_rules! with_samples {
    ($samples:expr, $slice:ident => $body:expr) => {
        $crate::with_samples!(@ $samples, $slice, $body, U8 I8 U16 I16 U32 I32 F32 F64)
    };
    (@ $samples:expr, $slice:ident, $body:expr, $($variant:ident)*) => {
        match $samples {
            $($crate::volume::Samples::$variant($slice) => $body,)*
        }
    };
}

/// Runs `$body` with `$T` as the Rust type of a [`SampleType`]; compiles `$body` once per type.
#[doc(hidden)]
#[macro_export]
macro_rules! with_sample_type {
    ($sample_type:expr, $T:ident => $body:expr) => {
        $crate::with_sample_type!(@ $sample_type, $T, $body,
            U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, F32 f32, F64 f64)
    };
    (@ $sample_type:expr, $T:ident, $body:expr, $($variant:ident $type:ty),*) => {
        match $sample_type {
            $($crate::volume::SampleType::$variant => {
                type $T = $type;
                $body
            })*
        }
    };
}
