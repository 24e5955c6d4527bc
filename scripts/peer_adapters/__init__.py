"""Operations of deadtime in the place of scipy's and python-control's, for their own tests."""
