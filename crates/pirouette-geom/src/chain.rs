//! Kinematic chains in the plane: bones, angles, forward kinematics.
