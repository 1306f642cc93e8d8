"""Parts of ``identify``: physically consistent tools, what a motion determines of them, mountings, poses, channels."""
