//! Skinned glTF 2.0 and VRM humanoids as avatars.
