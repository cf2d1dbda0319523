"""Operations on points, voxels and boxes that torch does not have."""
