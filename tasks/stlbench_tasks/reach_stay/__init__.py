"""The third form of the paper's fragment: reach a disc in time and stay there."""
