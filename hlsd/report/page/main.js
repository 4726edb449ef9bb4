startLegend();
startRegression();
startProfiles();
startIncidence();
startRunsTable();
startMaps();
startReplay();
startKeys();
startPlannerTables();
startTips();
startScrolling();
startTheme(); // draws everything, when all is there to be drawn
startLive();
