startLegend();
startRegression();
startProfiles();
startIncidence();
startRunsTable();
startMaps();
startReplay();
startTheme(); // draws everything, when all is there to be drawn
