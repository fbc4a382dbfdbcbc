//! GrabCut: from a photo and a seed mask to a silhouette.
