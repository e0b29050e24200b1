//! The DICOM tags that are read, with their names in DICOM PS3.6.

use std::fmt;

/// A tag, which identifies an element: 16 bits of group and 16 bits of element number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Tag(u32);

impl Tag {
    pub(super) const fn new(group: u16, element: u16) -> Tag {
        Tag((group as u32) << 16 | element as u32)
    }

    /// Returns whether the tag starts or ends an item or ends a sequence; such elements have no value representation.
    pub(super) const fn is_delimiter(self) -> bool {
        self.0 >> 16 == 0xfffe
    }

    /// Returns whether the tag is that of one of the three elements that hold pixels.
    pub(super) fn is_pixels(self) -> bool {
        [PIXELS, FLOAT_PIXELS, DOUBLE_PIXELS].contains(&self)
    }
}

impl fmt::Display for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "({:04X},{:04X})", self.0 >> 16, self.0 & 0xffff)
    }
}

/// Defines a constant for each tag, and `WANTED`, the list of the tags in the first part of the macro's input.
macro_rules! tags {
    (wanted { $($wanted:ident $wanted_group:literal $wanted_element:literal)* }
     known { $($name:ident $group:literal $element:literal)* }) => {
        $(pub(super) const $wanted: Tag = Tag::new($wanted_group, $wanted_element);)*
        $(pub(super) const $name: Tag = Tag::new($group, $element);)*
        /// The tags whose values are kept.
        pub(super) const WANTED: &[Tag] = &[$($wanted),*];
    };
}

tags! {
    wanted {
        IMAGE_TYPE 0x0008 0x0008
        SOP_CLASS 0x0008 0x0016
        ACQUISITION_TIME 0x0008 0x0032
        MODALITY 0x0008 0x0060
        SERIES_DESCRIPTION 0x0008 0x103e
        SLICE_THICKNESS 0x0018 0x0050
        ECHO_TIME 0x0018 0x0081
        SLICE_SPACING 0x0018 0x0088
        TRIGGER_TIME 0x0018 0x1060
        IMAGER_SPACING 0x0018 0x1164
        B_VALUE 0x0018 0x9087
        SERIES_UID 0x0020 0x000e
        SERIES_NUMBER 0x0020 0x0011
        ACQUISITION_NUMBER 0x0020 0x0012
        INSTANCE_NUMBER 0x0020 0x0013
        POSITION 0x0020 0x0032
        ORIENTATION 0x0020 0x0037
        TEMPORAL_POSITION 0x0020 0x0100
        STACK 0x0020 0x9056
        TEMPORAL_INDEX 0x0020 0x9128
        SAMPLES_PER_PIXEL 0x0028 0x0002
        PHOTOMETRIC 0x0028 0x0004
        FRAME_COUNT 0x0028 0x0008
        ROWS 0x0028 0x0010
        COLUMNS 0x0028 0x0011
        PIXEL_SPACING 0x0028 0x0030
        BITS_ALLOCATED 0x0028 0x0100
        BITS_STORED 0x0028 0x0101
        HIGH_BIT 0x0028 0x0102
        PIXEL_REPRESENTATION 0x0028 0x0103
        INTERCEPT 0x0028 0x1052
        SLOPE 0x0028 0x1053
        FRAME_OFFSETS 0x3004 0x000c
        DOSE_SCALING 0x3004 0x000e
    }
    known {
        TRANSFER_SYNTAX 0x0002 0x0010
        MODALITY_LUT 0x0028 0x3000
        SHARED_GROUPS 0x5200 0x9229
        FRAME_GROUPS 0x5200 0x9230
        FRAME_CONTENT 0x0020 0x9111
        PLANE_POSITION 0x0020 0x9113
        PLANE_ORIENTATION 0x0020 0x9116
        PIXEL_MEASURES 0x0028 0x9110
        PIXEL_TRANSFORMATION 0x0028 0x9145
        FLOAT_PIXELS 0x7fe0 0x0008
        DOUBLE_PIXELS 0x7fe0 0x0009
        PIXELS 0x7fe0 0x0010
        ITEM 0xfffe 0xe000
        ITEM_END 0xfffe 0xe00d
        SEQUENCE_END 0xfffe 0xe0dd
    }
}

/// The tags whose values are 16-bit numbers; all other kept values are text.
pub(super) const NUMBERS: &[Tag] =
    &[SAMPLES_PER_PIXEL, ROWS, COLUMNS, BITS_ALLOCATED, BITS_STORED, HIGH_BIT, PIXEL_REPRESENTATION];

/// The functional groups whose values are kept.
pub(super) const GROUPS: &[Tag] =
    &[FRAME_CONTENT, PLANE_POSITION, PLANE_ORIENTATION, PIXEL_MEASURES, PIXEL_TRANSFORMATION];

/// The tags of sequences, for files that do not state the kinds of their elements.
pub(super) const SEQUENCES: &[Tag] = &[
    SHARED_GROUPS,
    FRAME_GROUPS,
    FRAME_CONTENT,
    PLANE_POSITION,
    PLANE_ORIENTATION,
    PIXEL_MEASURES,
    PIXEL_TRANSFORMATION,
    MODALITY_LUT,
];

/// The value representations with two reserved bytes and a 4-byte length (PS3.5, table 7.1-1).
pub(super) const LONG_FORMS: &[&[u8; 2]] =
    &[b"OB", b"OD", b"OF", b"OL", b"OV", b"OW", b"SQ", b"SV", b"UC", b"UN", b"UR", b"UT", b"UV"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sequence_of_values_is_known_as_one() {
        assert!(GROUPS.iter().all(|group| SEQUENCES.contains(group)));
        assert!(WANTED.iter().all(|tag| !SEQUENCES.contains(tag)));
    }
}
